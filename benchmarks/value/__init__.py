"""Does choosing demonstrations with rpil make better policies, measured by driving them? Run `policy_value.py`.

`worlds` and `operators` make demonstrations of known quality, `rules` give weights to their steps, `learners` train
policies with these weights, and the worlds drive the policies.
"""
