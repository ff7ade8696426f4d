"""RML, the Runtime Monitoring Language: parser, checker, formatter, interpreter, and the monitor `rml.spec`."""
