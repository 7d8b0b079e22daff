"""The paper's experiments, run and set beside its figures."""
