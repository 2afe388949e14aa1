"""Virtual sliding: modes (B, S), the rules on them, their kinematic feasibility and listing."""
