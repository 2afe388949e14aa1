"""Robust joint torques for quasi-static graspless manipulation.

Which joint torques keep a push, slide, pivot or hold robust while the object also leans on its
surroundings, and how robust is it? The method is Makita and Maeda's *Joint Torque Optimization for
Quasi-static Graspless Manipulation*.
"""

import lazy_loader

# Each name is loaded at first use: arrays need no Pinocchio, scenes no pandas, and the command line
# is there to answer Ctrl-C while all of them are loaded. Which they are stands in the .pyi beside.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
