"""Where bodies touch and what a motion does there."""
