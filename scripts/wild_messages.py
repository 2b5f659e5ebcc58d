"""Messages of the right types with values that no program should send."""
import math
import re
from io import BytesIO


def wild_number(kind, value, choice):
    if kind in ("float32", "float64"):
        return choice.choice([math.nan, math.inf, -math.inf, 0.0, -1.0, 1e30, 1e-30, -value])
    bits, signed = int(re.search(r"\d+$", kind).group()), not kind.startswith("u")
    top = (1 << (bits - signed)) - 1
    return choice.choice([0, 1, top, top - 3, top // 2 + 1, -top - 1 if signed else top // 3])


def make_wild(message, share, choice):
    """Changes a share of the message's values, at any depth, to others of their types."""
    for name, kind in zip(message.__slots__, message._slot_types):  # pylint: disable=protected-access
        value = getattr(message, name)
        if hasattr(value, "_slot_types") and kind != "time":
            make_wild(value, share, choice)
        elif isinstance(value, list) and value and hasattr(value[0], "_slot_types"):
            for element in value:
                make_wild(element, share, choice)
        elif choice.random() > share:
            continue
        elif kind == "time":
            value.secs, value.nsecs = choice.choice([0, 1, 2**31, 2**32 - 1]), choice.choice([0, 10**9 - 1, 2**32 - 1])
        elif kind == "string":
            setattr(message, name, choice.choice(["", "/", "x" * 10000, "\n", value[:-1]]))
        elif isinstance(value, bytes):
            setattr(message, name, choice.choice([b"", value[:-1], value + b"\0", bytes(len(value)), choice.randbytes(len(value))]))
        elif isinstance(value, (list, tuple)):
            number = kind.split("[")[0]
            setattr(message, name, [wild_number(number, v, choice) if choice.random() < 0.2 else v for v in value])
        elif kind != "bool":
            setattr(message, name, wild_number(kind, value, choice))


def made_wild(message, share, choice):
    """A changed copy. choice: a random.Random"""
    buffer = BytesIO()
    message.serialize(buffer)
    copy = type(message)().deserialize(buffer.getvalue())
    make_wild(copy, share, choice)
    return copy
