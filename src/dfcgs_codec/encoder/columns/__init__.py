"""How symbols are coded best."""
