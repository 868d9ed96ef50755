"""P-frames checked in the image: what errors of a few patches say."""

from __future__ import annotations

import pytest

from dfcgs_codec.encoder.images.watch import summed_errors


def test_one_patch_alone_does_not_make_a_frame_worse() -> None:
    usual = [(1e-4 * (1 + i % 3), 1e-4) for i in range(7)]
    assert summed_errors([*usual, (5e-2, 1e-4)]) == pytest.approx(summed_errors([*usual, (3e-4, 1e-4)]))


def test_what_shows_in_several_patches_counts() -> None:
    usual = [(1e-4, 1e-4)] * 6
    decoded, expected = summed_errors([*usual, (5e-2, 1e-4), (4e-2, 1e-4)])
    assert decoded == pytest.approx(4e-2, rel=0.05)
    assert expected == pytest.approx(7e-4, rel=0.01)


def test_where_nothing_is_looked_at_nothing_is_behind() -> None:
    decoded, expected = summed_errors([])
    assert decoded == expected > 0
