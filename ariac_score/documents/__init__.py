"""Files that people write: YAML and JSON, read within limits, checked against schemas."""
