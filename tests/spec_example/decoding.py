"""What the file decodes to, and how: by the decoder of the specification, which lets itself be watched."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any
from unittest import mock

from tests.spec_decoder import Decoder, RangeDecoder, columns, prior, published, turns
from tests.spec_decoder.lods import Lods
from tests.spec_decoder.output import Frame
from tests.spec_decoder.state import digest

_ATTRIBUTES = ("POSITION", "SCALE", "ROTATION", "OPACITY", "SH_DC")
#: streams in the order in which they are read
_STREAMS = (
    *(f"{name}, frame 0" for name in ("POSITION", "COVER", "SCALE", "OPACITY", "POSITION_BITS")),
    *(f"{name}, frame 0" for name in ("ROTATION", "SH_DC")),
    *(f"{name}, frame 1" for name in ("who follows", "control points", "POSITION", "ROTATION", "SH_DC")),
)
_SHOWN = ("POSITION, frame 0", "SCALE, frame 0", "who follows, frame 1", "SH_DC, frame 1")
#: rows of states that are shown
_NUM_ROWS = 3
#: values of a call that are shown
_NUM_VALUES = 66
_PROCEDURES = ("bits", "escapes", "grouped", "residuals")
#: a row of a level in a column of each rule, by number of the column and row
_COLUMNS = {1: ("column 0 of SCALE, frame 0", 43), 20: ("column 0 of SH_DC, frame 1", 43)}
_TURN = 43


def _joined(values: Sequence[Any]) -> str:
    return " ".join(f"{value:.9g}" if isinstance(value, float) else str(value) for value in values)


def _described(frame: Frame) -> Iterator[str]:
    number = frame.sequence.frame_numbers[frame.index]
    yield f"frame {frame.index}, number {number}: hash {frame.state.hash().hex()}"
    for attribute, plane in frame.state.planes.items():
        rows = "  ".join(_joined(row) for row in plane[:_NUM_ROWS])
        yield f"  state {_ATTRIBUTES[attribute]:<9} {rows}  ...  digest {digest(plane).hex()}"
    for name, values in frame.output().items():
        yield f"  output {name:<8} {_joined(values[:_NUM_ROWS])}  ..."


@dataclass
class Watch:
    """Lines about the streams, and about some rows, of a file while it is decoded."""

    frames: list[str] = field(default_factory=list)
    streams: list[list[str]] = field(default_factory=list)
    rows: list[str] = field(default_factory=list)
    _depth: int = 0
    _num_columns: int = 0
    _num_turns: int = 0
    _class: str = ""

    def decode(self, data: bytes) -> None:
        """Decode and watch."""
        patches = [
            mock.patch.object(RangeDecoder, "__init__", self._opening(RangeDecoder.__init__)),
            *(mock.patch.object(RangeDecoder, n, self._calling(n)) for n in (*_PROCEDURES, "decode")),
            mock.patch.object(columns, "decoded", self._column(columns.decoded)),
            mock.patch.object(prior, "decoded", self._column(columns.decoded)),
            mock.patch.object(prior.PriorModel, "kind", self._kind(prior.PriorModel.kind)),
            mock.patch.object(turns, "expected_turn", self._turn(turns.expected_turn)),
        ]
        for patch in patches:
            patch.start()
        try:
            for frame in Decoder(data, published()).frames():
                self.frames += _described(frame)
        finally:
            for patch in patches:
                patch.stop()

    def _opening(self, init: Any) -> Any:
        def opened(stream: RangeDecoder, data: bytes) -> None:
            init(stream, data)
            self.streams.append([])

        return opened

    def _calling(self, name: str) -> Any:
        """Procedures of chapter 10: a line for each call that no other makes."""
        procedure = getattr(RangeDecoder, name)

        def called(*arguments: Any) -> Any:
            self._depth += 1
            values = procedure(*arguments)
            self._depth -= 1
            listed = values if isinstance(values, list) else [values]
            if self._depth == 0 and listed:
                more = "  ..." if len(listed) > _NUM_VALUES else ""
                shown = _joined(listed[:_NUM_VALUES]) + more
                self.streams[-1].append(f"  {name:<9} {len(listed):>3}  {shown}")
            return values

        return called

    def _column(self, decoded: Any) -> Any:
        def watched(stream: RangeDecoder, lods: Lods, rule: Any) -> Any:
            number, self._num_columns = self._num_columns, self._num_columns + 1
            if number not in _COLUMNS:
                return decoded(stream, lods, rule)
            name, row = _COLUMNS[number]
            of, told = rule.of, []

            def noted(i: int, statistics: Any) -> Any:
                found = of(i, statistics)
                if i == row:
                    told.append((statistics, found, self._class))
                return found

            rule.of = noted
            value, residual = decoded(stream, lods, rule)
            (statistics, (prediction, context), class_line), near = told[0], _neighbours(lods, row)
            self.rows += [
                f"{name}, row {row}",
                f"  neighbours {_joined(near)}  weights {_joined(lods.weights(row, near))}",
                f"  their values {_joined([value[j] for j in near])}",
                f"  mean {statistics[0]}  deviation {statistics[1]}",
                *_rule_lines(rule, row, class_line),
                f"  prediction {prediction}  context {context}  table {rule.tables[context]}",
                f"  residual {residual[row]}  value {value[row]}",
            ]
            return value, residual

        return watched

    def _kind(self, kind: Any) -> Any:
        def watched(model: Any, name: str, x: list[int]) -> int:
            found: int = kind(model, name, x)
            self._class = f"  x, u {_joined(x)}  class {found}"
            return found

        return watched

    def _turn(self, expected_turn: Any) -> Any:
        """The level's rows are 1, 3, 5 and so on."""

        def watched(is_needle: bool, axes: Any, weight: list[int]) -> Any:
            found = expected_turn(is_needle, axes, weight)
            row, self._num_turns = 2 * self._num_turns + 1, self._num_turns + 1
            if row == _TURN:
                nearest = axes[weight.index(max(weight))]
                self.rows += [
                    f"ROTATION, frame 0, row {row}, a {'needle' if is_needle else 'disc'}",
                    f"  axes of the nearest neighbour {'  '.join(map(_joined, nearest))}",
                    f"  frame {_joined(found.frame)}",
                    f"  tilt_expected {found.tilt}  spin_expected {found.spin}",
                ]
            return found

        return watched


def _neighbours(lods: Lods, row: int) -> list[int]:
    return next(neighbours(row) for rows, neighbours in lods.levels() if row in rows)


def _rule_lines(rule: Any, row: int, class_line: str) -> list[str]:
    if class_line and isinstance(rule, prior.PriorRule):
        return [f"  weights of the column {_joined(rule.column.weights)}", class_line]
    step, in_steps = rule.steps.step[row], "in steps" if rule.steps.in_steps else "not in steps"
    weights = f"weights {_joined(rule.weights)}  size weights {_joined(rule.size_weights)}"
    return [f"  center {rule.center}  {weights}", f"  step {step}, {in_steps}"]


def described(data: bytes) -> dict[str, list[str]]:
    """Lines of the frames, of the values read from some streams, and of some rows."""
    watch = Watch()
    watch.decode(data)
    streams = dict(zip(_STREAMS, watch.streams, strict=True))
    shown = [line for name in _SHOWN for line in (f"stream of {name}", *streams[name])]
    return {"frames": watch.frames, "streams": shown, "rows": watch.rows}
