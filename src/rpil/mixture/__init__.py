"""The paper's mixture: adversaries psi(a|s), priors, EM, and its starts."""
