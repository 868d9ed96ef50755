"""All methods of the comparison by name."""

from __future__ import annotations

from evaluation.baselines.method import Method

_ALL: tuple[Method, ...] = ()

METHODS: dict[str, Method] = {method.name: method for method in _ALL}
