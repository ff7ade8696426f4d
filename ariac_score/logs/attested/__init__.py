"""Holding a recording against what its recorder attests: its heartbeats and manifest."""

from ariac_score.logs.attested.held import attestation_of
from ariac_score.logs.attested.recorded import HEARTBEAT, MANIFEST, digest_of

__all__ = ["HEARTBEAT", "MANIFEST", "attestation_of", "digest_of"]
