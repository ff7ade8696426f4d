"""Hosting a competition where others run the server: Codabench and EvalAI.

The engine knows nothing of either. A submission is scored into one neutral export, and a thin
translator for each platform says it in the words that its code really takes.
"""
