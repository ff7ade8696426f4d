"""A monitor node that asks an oracle of ariac-score about every message. Python 3.8 and later."""

__all__ = []
