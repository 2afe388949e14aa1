"""A hand: URDFs in Pinocchio, fingers, couplings, control, Jacobians, limits."""
