"""Tables of `docs/` and README.md, made from `evaluation/results/*.json`: `python -m evaluation.tables`."""
