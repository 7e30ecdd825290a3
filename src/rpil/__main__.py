"""``python -m rpil`` is the command ``rpil``."""

from rpil.cli.entry import main

if __name__ == "__main__":
    main()
