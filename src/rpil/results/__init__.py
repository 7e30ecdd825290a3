"""The audit: verdicts, probabilities and reports for the user."""
