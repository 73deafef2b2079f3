"""`python -m dtrepair`: the same as the command `dtrepair`."""

from dtrepair.cli import main

if __name__ == "__main__":
    main()
