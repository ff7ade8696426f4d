"""Signal temporal logic over the signals of a trial."""

from ariac_score_stl.formula import StlFormula

__all__ = ["StlFormula"]
