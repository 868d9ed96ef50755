"""Files and folders that appear under their name only when they are whole, and are on the disk by then.

Nothing is replaced unless the caller says `force`; what an ended run left behind goes with the next one.
"""

from dfcgs_codec.files.system import begin_sync, named
from dfcgs_codec.files.targets import FRAME_NAME, FRAME_PATTERN
from dfcgs_codec.files.unfinished import put_away_all
from dfcgs_codec.files.whole_file import check_file_target, replace_when_whole
from dfcgs_codec.files.whole_folder import replace_folder_when_whole

__all__ = [
    "FRAME_NAME",
    "FRAME_PATTERN",
    "begin_sync",
    "check_file_target",
    "named",
    "put_away_all",
    "replace_folder_when_whole",
    "replace_when_whole",
]
