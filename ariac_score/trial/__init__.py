"""What happened in a trial: orders, submissions, events and measured signals.

Nothing in here knows about rules, monitors, prices or points.
"""
