"""Solutions for people and for other programs: tables and JSON."""

import lazy_loader

# Each name is loaded at its first use; `__init__.pyi` lists them all.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
