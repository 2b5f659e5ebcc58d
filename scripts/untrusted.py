"""Files and YAML of others, for the scripts: what never ends, or stands for more than it has, is refused."""
import os
import stat

import yaml


class Refused(ValueError):
    """What cannot be used; the text says why."""


class Loader(yaml.SafeLoader):
    """Without aliases: nine lines of them can stand for a billion values."""

    def compose_node(self, parent, index):
        if self.check_event(yaml.events.AliasEvent):
            raise yaml.YAMLError("has an alias (*name): write out what it stands for")
        return super().compose_node(parent, index)


def read_file(path, max_bytes=1 << 20):
    """The bytes of a file, not of a pipe or device, which may never end."""
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise Refused("is no file, but a pipe or a device")
        if status.st_size > max_bytes:
            raise Refused(f"has {status.st_size} bytes: at most {max_bytes}")
        return file.read(max_bytes)
