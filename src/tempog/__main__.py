"""``python -m tempog``."""

from tempog.cli import main

if __name__ == "__main__":
    main()
