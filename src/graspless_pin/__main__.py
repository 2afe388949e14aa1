"""``python -m graspless_pin``: the command line."""

from graspless_pin.cli import main

main()
