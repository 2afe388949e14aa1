"""Robust joint torques for quasi-static graspless manipulation.

Which joint torques keep a push, slide, pivot or hold robust while the object also leans on its
surroundings, and how robust is it? The method is Makita and Maeda's *Joint Torque Optimization for
Quasi-static Graspless Manipulation*.
"""

import lazy_loader

# Each name is loaded at first use: arrays need no Pinocchio, scenes no pandas, and the command line
# can handle Ctrl-C while they are loaded. The .pyi file in this folder lists the names.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
