"""How control points carry the Gaussians of a GoF along (spec section 14)."""
