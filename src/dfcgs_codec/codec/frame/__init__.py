"""A frame after the other: chunks to states, what is in a file, what can be had of a damaged one."""
