"""Files <-> GaussianCloud: 3DGS PLYs as they are written in the wild, and formats that have a reader.

    policy    what a caller allows (InputPolicy), what a header says (PlyHeader)
    header    bytes -> elements and properties; schema: which of them are a 3DGS frame
    body      rows -> arrays; repair: what is done to their values; read: all of it in order
    write     GaussianCloud -> PLY; comments: which comment lines are worth keeping
    formats   what other files are, and what makes PLYs of them; foreign: those that are read
    frames    peek_header and read_ply, for files whose names, in lower case, end in FRAME_SUFFIXES

Headers of a whole sequence are read with `peek_header` before the first frame; `said_once` makes lines for
the user of what they say.
"""

from dfcgs_codec.ply.comments import display_comments
from dfcgs_codec.ply.formats import FRAME_SUFFIXES, describe_foreign
from dfcgs_codec.ply.frames import peek_header, read_ply
from dfcgs_codec.ply.policy import InputPolicy, PlyHeader, gathered, said_once
from dfcgs_codec.ply.schema import property_names
from dfcgs_codec.ply.write import write_ply

__all__ = [
    "FRAME_SUFFIXES",
    "InputPolicy",
    "PlyHeader",
    "describe_foreign",
    "display_comments",
    "gathered",
    "peek_header",
    "property_names",
    "read_ply",
    "said_once",
    "write_ply",
]
