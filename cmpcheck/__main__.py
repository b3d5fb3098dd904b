"""`python -m cmpcheck`: the same as the command `cmpcheck`."""

from cmpcheck.cli import main

if __name__ == "__main__":
    main()
