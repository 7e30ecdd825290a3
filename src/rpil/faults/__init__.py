"""Recording faults: rules without a model, whose findings stand beside the trust in a demonstration."""
