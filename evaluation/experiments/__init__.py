"""Comparisons that answer one question each, mostly about one tool of the encoder; run by `make bench-*`.

i_frames    I-frames alone: other formats, quantised input, surroundings, proportions of steps
paper       profile `paper`: against `main`, its tables, its rule of compensation
"""
