"""An adversary: what doctored copies of a log, or other behaviour, would score."""
