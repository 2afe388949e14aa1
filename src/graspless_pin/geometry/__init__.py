"""Hand, shapes, bodies, contacts, Jacobians and motion: all that knows Pinocchio and coal."""
