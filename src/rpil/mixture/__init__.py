"""The paper's mixture: adversaries psi(a|s), priors, and EM."""
