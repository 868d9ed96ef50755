"""Moving Gaussian scenes for training and evaluation; every sequence follows from its options and seed.

animated_sequence   an animated glTF asset -> Gaussians on its surface
trained_sequence    a static trained splat -> the same in motion
stress_sequence     sequences that break codecs
fitted_sequence     frames that were optimised against images, from a file of `assets/fitted`
SURROUNDINGS        a frame -> the same in a room, under a dome, in a haze
VARIANTS            a clean sequence -> noisy, drifting, semi-tracked, permuted, untracked, ...
"""

from lab.scenes.animated import animated_sequence
from lab.scenes.fitted import fitted_sequence
from lab.scenes.options import SceneOptions
from lab.scenes.semi_tracked import semi_tracked_with_ids
from lab.scenes.stress import STRESS, stress_sequence
from lab.scenes.surroundings import SURROUNDINGS
from lab.scenes.trained import MOTIONS, trained_sequence
from lab.scenes.variants import VARIANTS, permuted_with_ids

__all__ = [
    "MOTIONS",
    "STRESS",
    "SURROUNDINGS",
    "VARIANTS",
    "SceneOptions",
    "animated_sequence",
    "fitted_sequence",
    "permuted_with_ids",
    "semi_tracked_with_ids",
    "stress_sequence",
    "trained_sequence",
]
