"""Estimators with scikit-learn's interface, and their files."""
