"""Which order names of files stand for; each row was somebody's folder."""

from __future__ import annotations

import random
import re

import pytest

from dfcgs_codec.errors import InputError
from dfcgs_codec.frames.order import order_of

#: names in the order of frames, the numbers they get, and a word of the note that says so
ORDERS = {
    "times": ("time_0.0 time_0.05 time_0.1 time_0.15 time_0.2", [0, 1, 2, 3, 4], "decimal"),
    "times, padded": ("time_0.00 time_0.05 time_0.10", [0, 1, 2], "decimal"),
    "times, tenths": ("time_0.1 time_0.2 time_0.3", [0, 1, 2], "decimal"),
    "times, whole ones without a point": ("time_0 time_0.5 time_1 time_1.5", [0, 1, 2, 3], "decimal"),
    "times with a comma": ("t0,0 t0,05 t0,1", [0, 1, 2], "decimal"),
    "times as Python prints them": ("t_1e-05 t_0.1 t_0.15000000000000002 t_1.0", [0, 1, 2, 3], "decimal"),
    "times around a cut": ("t-0.5 t+0.0 t+0.5", [0, 1, 2], "decimal"),
    "negative": ("frame_-2 frame_-1 frame_0 frame_1", [0, 1, 2, 3], "negative"),
    "negative, all of them": ("frame_-3 frame_-2 frame_-1", [0, 1, 2], "negative"),
    "negative, nothing before": ("-2 -1 0 1", [0, 1, 2, 3], "negative"),
    "negative after a letter": ("frame-2 frame-1 frame0 frame1", [0, 1, 2, 3], "negative"),
    "a dash that separates": ("scene-1 scene-2 scene-10", None, ""),
    "milliseconds": ("1699999999900 1699999999933 1699999999966", [0, 1, 2], "time stamps"),
    "nanoseconds": (f"t_{2**63 - 34} t_{2**63 - 1}", [0, 1], "time stamps"),
    "seconds with fractions": ("1699999999.9 1699999999.933 1700000000.0", [0, 1, 2], "decimal"),
    "the largest number that is kept": (f"f_{2**32 - 2} f_{2**32 - 1}", [2**32 - 2, 2**32 - 1], ""),
    "a date before": ("2024-01-05_0001 2024-01-05_0002", [1, 2], ""),
    "a version before": ("v2_frame_0001 v2_frame_0002", [1, 2], ""),
    "a long version before": ("v1.2.3_0001 v1.2.3_0002", [1, 2], ""),
    "a dot before": ("frame.0001 frame.0002", [1, 2], ""),
    "a dot before, and a take": ("scene.2.0001 scene.2.0002", [1, 2], ""),
    "a dot before, unpadded": ("s.1.8 s.1.9 s.1.10 s.1.11", [8, 9, 10, 11], ""),
    "the same number twice": ("frame_0001/f_1 frame_0002/f_2", [1, 2], ""),
    "parts": ("part1_f_1 part1_f_2 part2_f_3", [1, 2, 3], ""),
    "cameras by turns": ("cam1_f_5 cam2_f_6 cam1_f_7", [5, 6, 7], ""),
    "another case": ("Frame_1 frame_2", [1, 2], ""),
    "one file": ("garden", [0], ""),
    "one file of a time": ("time_0.25", [0], "decimal"),
    "iterations": ("f1/iteration_900/p f2/iteration_700/p f3/iteration_800/p", [1, 2, 3], ""),
    "nothing but iterations": ("iteration_1/p iteration_2/p", [1, 2], ""),
}


@pytest.mark.parametrize("situation", ORDERS)
def test_order(situation: str) -> None:
    text, numbers, word = ORDERS[situation]
    wanted = [f"{name}.ply" for name in text.split()]
    allow_gaps = numbers is None
    for seed in range(3):
        names = random.Random(seed).sample(wanted, len(wanted))
        order = order_of(names, allow_gaps=allow_gaps)
        assert [names[i] for i in order.index] == wanted
        assert order.numbers == ([1, 2, 10] if numbers is None else numbers)
        assert len(order.notes) == bool(word)
        assert all(word in note for note in order.notes)


#: names that are refused, and what the message has to hold
REFUSALS = {
    "a copy": ("f_0001 f_0002 f_0002_(1)", ["f_0002_(1).ply is not named like the other 2"]),
    "a copy with a point": ("f_0001 f_0002 f_0003 f_0002.1", ["f_0002.1.ply is not named like the other 3"]),
    "one without a number": ("f_1 f_2 background", ["background.ply is not named like the other 2"]),
    "two of one number": ("f_0 f_1 f_01 f_2", ["f_1.ply", "f_01.ply", "same frame number"]),
    "two of one time": ("t_0.1 t_0.10 t_0.2", ["t_0.1.ply", "t_0.10.ply"]),
    "two numbers": ("f_1_cam_9 f_2_cam_8", ["1 and 9", "--order-by 'f_{}'", "--order-by '_cam_{}'"]),
    "frame and time": ("f_1_t0.1 f_2_t0.2", ["1 and 0.1 in f_1_t0.1.ply", "--order-by '_t{}'"]),
    "cameras": ("c0_0 c0_1 c1_0 c1_1", ["c0_0.ply and c0_1.ply", "--pattern", "'c1_*.ply'", "'c*_1.ply'"]),
    "left and right": ("left_0 left_1 right_0 right_1", ["share one numbering", "--pattern 'left_*.ply'"]),
    "no numbers": ("a b c", ["no number", "a.ply, b.ply, c.ply", "--order-by name"]),
    "dates": ("2024-01-30 2024-01-31 2024-02-01", ["disagree", "30 and 01", "--order-by name"]),
    "clock": ("12-30-59_966 12-31-00_000 12-31-00_033", ["disagree", "--order-by name"]),
    "decimals or not": ("s.1.8 s.1.9 s.1.10 s.1.12", ["1.10", "--order-by name"]),
    "decimals behind '_'": ("0_0 0_05 0_1 0_15 0_2", ["padded with zeros unevenly", "0.05"]),
    "too large": (f"f_{2**63} f_{2**63 + 1}", [f"f_{2**63 + 1}.ply", str(2**63 - 1)]),
}


@pytest.mark.parametrize("situation", REFUSALS)
@pytest.mark.parametrize("allow_gaps", [False, True])
def test_refusal(situation: str, allow_gaps: bool) -> None:
    text, words = REFUSALS[situation]
    with pytest.raises(InputError) as caught:
        order_of([f"{name}.ply" for name in text.split()], allow_gaps=allow_gaps)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("situation", REFUSALS)
def test_advice_on_the_order_works(situation: str) -> None:
    names = [f"{name}.ply" for name in REFUSALS[situation][0].split()]
    with pytest.raises(InputError) as caught:
        order_of(names)
    ways = re.findall(r"--order-by ('[^']*'|\w+)", str(caught.value))
    for way in ways:
        order = order_of(names, way.strip("'"), allow_gaps=True)
        assert sorted(order.index) == list(range(len(names)))


def test_missing_numbers_are_refused_but_not_missing_times() -> None:
    for names in (["f_1.ply", "f_2.ply", "f_5.ply"], ["f_-3.ply", "f_0.ply", "f_1.ply"]):
        with pytest.raises(InputError, match=r"missing.*--allow-gaps"):
            order_of(names)
        assert len(order_of(names, allow_gaps=True).numbers) == 3


#: --order-by, names in that order, numbers
CHOICES = [
    ("name", "a2 a10 b1", [0, 1, 2]),
    ("name", "2024-01-31_1 2024-02-01_0", [0, 1]),
    ("f_{}", "f_1_cam_9 f_2_cam_8", [1, 2]),
    ("_cam_{}", "f_2_cam_8 f_1_cam_9", [8, 9]),
    ("f*_t{}", "f_9_t0.05 f_8_t0.1", [0, 1]),
    ("{}_", "1_b 2_a", [1, 2]),
    ("scene-{}", "scene-1 scene-2", [1, 2]),
    ("x{}", "x-1 x0 x1", [0, 1, 2]),
    ("iteration_{}", "f2/iteration_7/p f1/iteration_8/p", [7, 8]),
]


@pytest.mark.parametrize(("order_by", "text", "numbers"), CHOICES)
def test_another_order(order_by: str, text: str, numbers: list[int]) -> None:
    wanted = [f"{name}.ply" for name in text.split()]
    names = sorted(wanted, reverse=True)
    order = order_of(names, order_by)
    assert [names[i] for i in order.index] == wanted
    assert order.numbers == numbers


@pytest.mark.parametrize("order_by", ["time", "", "frame_", "{}_{}", "g_{}"])
def test_orders_that_cannot_be(order_by: str) -> None:
    with pytest.raises(InputError, match="--order-by"):
        order_of(["f_1.ply", "f_2.ply"], order_by)
