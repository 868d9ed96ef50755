"""Little-endian fields and variable-length integers (spec section 1.4)."""

from __future__ import annotations

import struct

from dfcgs_codec.errors import BitstreamError, CorruptBitstream, TruncatedBitstream

_MAX_UVARINT_BYTES = 10


class ByteWriter:
    """Appends fields to a growing byte string."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def __len__(self) -> int:
        return len(self._bytes)

    def u8(self, value: int) -> None:
        """One byte, 0 to 255."""
        self._bytes.append(value)

    def u32(self, value: int) -> None:
        """Four bytes, little-endian."""
        self._bytes += struct.pack("<I", value)

    def u64(self, value: int) -> None:
        """Eight bytes, little-endian."""
        self._bytes += struct.pack("<Q", value)

    def uvarint(self, value: int) -> None:
        """LEB128, 0 to 2**64 - 1, in as few bytes as possible."""
        if not 0 <= value < 1 << 64:
            raise ValueError(f"uvarint out of range: {value}")
        while value >= 0x80:
            self._bytes.append(value & 0x7F | 0x80)
            value >>= 7
        self._bytes.append(value)

    def svarint(self, value: int) -> None:
        """Zigzag LEB128, -2**63 to 2**63 - 1."""
        self.uvarint(value * 2 if value >= 0 else -value * 2 - 1)

    def raw(self, data: bytes) -> None:
        """Bytes as they are."""
        self._bytes += data

    def getvalue(self) -> bytes:
        """All bytes so far."""
        return bytes(self._bytes)


class ByteReader:
    """Reads fields; a shortage is `shortage` with the byte's offset in the file.

    A payload whose checksum fits is whole, so for its fields `shortage` is CorruptBitstream.
    """

    def __init__(
        self,
        data: bytes | memoryview,
        base_offset: int = 0,
        shortage: type[BitstreamError] = TruncatedBitstream,
    ) -> None:
        self._data = memoryview(data)
        self._base = base_offset
        self._shortage = shortage
        self.position = 0

    @property
    def offset(self) -> int:
        """Byte position in the file."""
        return self._base + self.position

    @property
    def remaining(self) -> int:
        """Bytes not yet read."""
        return len(self._data) - self.position

    def raw(self, count: int) -> bytes:
        """The next `count` bytes."""
        if count > self.remaining:
            raise self._shortage(
                f"{count} bytes are needed and {self.remaining} are left",
                offset=self.offset,
            )
        start = self.position
        self.position += count
        return bytes(self._data[start : self.position])

    def u8(self) -> int:
        """One byte."""
        return self.raw(1)[0]

    def u32(self) -> int:
        """Four bytes, little-endian."""
        return int(struct.unpack("<I", self.raw(4))[0])

    def u64(self) -> int:
        """Eight bytes, little-endian."""
        return int(struct.unpack("<Q", self.raw(8))[0])

    def uvarint(self) -> int:
        """LEB128; longer than needed is corrupt, so that every value has one spelling."""
        start = self.offset
        value = 0
        for index in range(_MAX_UVARINT_BYTES):
            byte = self.u8()
            value |= (byte & 0x7F) << (7 * index)
            if byte < 0x80:
                if (byte == 0 and index > 0) or value >= 1 << 64:
                    break
                return value
        raise CorruptBitstream("variable-length integer is not in its shortest form", offset=start)

    def svarint(self) -> int:
        """Zigzag LEB128."""
        value = self.uvarint()
        return value >> 1 if value & 1 == 0 else -(value >> 1) - 1

    def text(self) -> str:
        """The rest as UTF-8, damaged characters replaced."""
        return self.raw(self.remaining).decode("utf-8", "replace")

    def expect_end(self, what: str) -> None:
        """Refuse bytes that no field claims."""
        if self.remaining:
            raise CorruptBitstream(f"{self.remaining} unused bytes after {what}", offset=self.offset)
