"""String stability of any law: measured, beside the theory of its linearisation."""
