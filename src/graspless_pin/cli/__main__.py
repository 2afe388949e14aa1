"""``python -m graspless_pin.cli``."""

from graspless_pin.cli import main

main()
