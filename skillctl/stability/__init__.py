"""What is proved of a skill, in exact arithmetic; and what sampling shows where nothing is proved."""

from skillctl.stability.certificate import certify
from skillctl.stability.report import (
    Certificate,
    ComponentCertificate,
    PartCertificate,
    Sampling,
    Scope,
    Verdict,
)

__all__ = [
    "Certificate",
    "ComponentCertificate",
    "PartCertificate",
    "Sampling",
    "Scope",
    "Verdict",
    "certify",
]
