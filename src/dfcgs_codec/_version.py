"""Version of the package; that of the bitstream is in bitstream_spec.md."""

__version__ = "0.1.0"
