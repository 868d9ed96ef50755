"""`python -m dfcgs_codec` is `dfcgs`."""

from dfcgs_codec.cli import main

if __name__ == "__main__":
    main()
