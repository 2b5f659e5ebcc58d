"""Networks of one or two operations as bytes in the ONNX format (onnx.proto3), so that tests need no package onnx."""
import struct

FLOAT, FLOAT16 = 1, 10  # TensorProto.DataType


def varint(number):
    parts = bytearray()
    while True:
        parts.append(number & 0x7f | (0x80 if number > 0x7f else 0))
        number >>= 7
        if not number:
            return bytes(parts)


def field(number, value):
    """A field of a protobuf message: an int as varint, a float as 32 bits, text and messages by length."""
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    if isinstance(value, float):
        return varint(number << 3 | 5) + struct.pack("<f", value)
    value = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(value)) + value


def tensor(name, shape, element=FLOAT):
    """A ValueInfoProto; an axis is a length, or a name where it is free."""
    axes = b"".join(field(1, field(1, n) if isinstance(n, int) else field(2, n)) for n in shape)
    return field(1, name) + field(2, field(1, field(1, element) + field(2, axes)))


def node(operation, inputs, output, **integers):
    """A NodeProto; attributes are ints or lists of them."""
    message = b"".join(field(1, name) for name in inputs) + field(2, output) + field(4, operation)
    for name, value in integers.items():
        if isinstance(value, int):
            message += field(5, field(1, name) + field(3, value) + field(20, 2))
        else:
            message += field(5, field(1, name) + b"".join(field(8, v) for v in value) + field(20, 7))
    return message


def model(nodes, inputs, outputs):
    """A ModelProto of opset 13."""
    graph = b"".join(field(1, n) for n in nodes) + field(2, "tiny") + b"".join(
        field(11, i) for i in inputs) + b"".join(field(12, o) for o in outputs)
    return field(1, 8) + field(8, field(1, "") + field(2, 13)) + field(7, graph)


def brightness(shape=(1, 3, "height", "width"), axis=1, element=FLOAT):
    """Mean of the colours of each pixel."""
    out = [1 if i == axis % len(shape) else n for i, n in enumerate(shape)]
    return model([node("ReduceMean", ["image"], "bright", axes=[axis], keepdims=1)], [tensor("image", shape, element)],
                 [tensor("bright", out, element)])
