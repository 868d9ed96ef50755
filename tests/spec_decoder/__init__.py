"""A decoder written from bitstream_spec.md alone: plain Python integers, nothing from the package.

It is slow and checks little; it exists to show that the text is complete. Its files follow the chapters;
functions carry the names of the text's pseudo-code, and comments cite its sections.
"""

from tests.spec_decoder.basics import ModelMismatch as ModelMismatch
from tests.spec_decoder.basics import Refused as Refused
from tests.spec_decoder.decoder import Decoder as Decoder
from tests.spec_decoder.models import Array as Array
from tests.spec_decoder.models import model_hash as model_hash
from tests.spec_decoder.models import published as published
from tests.spec_decoder.models import read_model as read_model
from tests.spec_decoder.prior import log as log
from tests.spec_decoder.stream import RangeDecoder as RangeDecoder
from tests.spec_decoder.tables import from_weights as from_weights
from tests.spec_decoder.tables import scale_model as scale_model
from tests.spec_decoder.tables import split_model as split_model
from tests.spec_decoder.tables import uniform as uniform
