"""Where viewers stand: camera poses beside a sequence, and places between and around them."""
