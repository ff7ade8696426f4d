"""The rule sets of RoboCup@Work."""
