"""Charts of the results, as SVG in `docs/charts` with the plotted figures as JSON beside each."""
