"""The suite: runs a case in several engines, compares what they did, and reports it."""

__version__ = "0.1.0"
