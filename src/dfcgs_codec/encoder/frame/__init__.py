"""A sequence of frames to a file: segments, GoFs, frames."""
