"""Rule sets and log maps, one folder for each edition. Data; read through `ariac_score.documents.yaml`."""
