"""Published JSON schemas. Data; read through `ariac_score.documents.yaml`."""
