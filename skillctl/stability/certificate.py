"""The stability certificate of a skill: re-derived from its numbers, never from what a file claims."""

from __future__ import annotations

from dataclasses import replace

from skillctl.model.chained import ChainedSkill
from skillctl.model.skill import ActingSkill, Skill
from skillctl.stability.blocks import coupled_radius
from skillctl.stability.parts import MARGIN, certify_part, least
from skillctl.stability.region import certified_radius
from skillctl.stability.report import (
    Certificate,
    Course,
    PartCertificate,
    Sampling,
    Scope,
    Verdict,
    at_least,
    least_frequency,
)
from skillctl.stability.sampling import search_witness
from skillctl.stability.stages import follow_stages, told


def certify(
    skill: Skill, *, digest: str | None = None, seed: int = 0, period: float | None = None
) -> Certificate:
    """Return what is proved about a skill, and what sampling shows where there is no global proof.

    Exact arithmetic on the stored numbers proves that each part converges exponentially from everywhere. Of
    poses, position and orientation have to contract by themselves; then no motion comes nearer to the
    orientations half a turn from the target, where its direction is not defined. Without that, and for a
    single part, only a radius is proved. For the whole it follows: A SEDS or merged skill is one part. A
    latched combined skill runs one part to its end. An instantaneous one with one attractor, one P and one
    kind of coordinates shrinks that P-norm whichever part acts, sliding motions included. In all other cases
    switching can trap a motion on a border between regions: then only a radius around each attractor is
    proved, and rollouts search for a witness. A chain runs one stage after the other to its end, if each is
    over where the next one is proved.

    Args:
        skill: What to certify.
        digest: Content digest of the artifact the skill was read from; the certificate names it.
        seed: Of the sampling, which runs only where there is no global proof.
        period: Of the controller in whose steps the course of a chain is bounded, [s]; by default half of the
            proved one.

    References:
        Eq. 5 and 7; theory page, verification.
    """
    parts = tuple(
        certify_part(number, part, skill.outer_speed)
        for number, part in enumerate(skill.acting_parts, start=1)
    )
    if isinstance(skill, ChainedSkill):
        return _chained(skill, parts, digest, period)
    failures = tuple(sentence for part in parts for sentence in part.failures)
    verdict: Verdict = "stable"
    scope: Scope = "global"
    sampling: Sampling | None = None
    if failures or not _parts_suffice(skill):
        scope = "none"
        if not failures:
            parts = tuple(replace(part, radius=certified_radius(skill, i)) for i, part in enumerate(parts))
            scope = "local" if _every_attractor_has_a_radius(skill, parts) else "none"
            failures = (_open_question(skill),)
        elif len(parts) == 1:
            parts = (_around(parts[0], skill.acting_parts[0]),)
            scope = "none" if parts[0].radius is None else "local"
        sampling = search_witness(skill, parts, seed)
        refuted = sampling.witness is not None or not all(part.proved for part in parts)
        verdict = "not proved" if refuted else "inconclusive"
    return Certificate(
        verdict=verdict,
        scope=scope,
        rate=None if scope == "none" else least([part.rate for part in parts]),
        period=None if scope == "none" else least([part.period for part in parts]),
        margin=MARGIN,
        parts=parts,
        proof=_proof(skill, scope, parts),
        failures=failures,
        evidence=() if sampling is None else (_evidence(sampling, skill.space.unit),),
        sampling=sampling,
        digest=digest,
        all_weights=scope == "global" and skill.kind == "merged",
    )


def _chained(
    chain: ChainedSkill, parts: tuple[PartCertificate, ...], digest: str | None, period: float | None
) -> Certificate:
    """Return what is proved of a chain whose parts are proved, each by itself, as it says."""
    parts = tuple(_around(part, acting) for part, acting in zip(parts, chain.acting_parts, strict=True))
    failures = tuple(sentence for part in parts for sentence in part.failures)
    rate, longest = least([part.rate for part in parts]), least([part.period for part in parts])
    course: Course | None = None
    known = all(part.proved or part.radius is not None for part in parts)
    if known and longest is not None:
        course, outside = follow_stages(chain, parts, 0.5 * longest if period is None else period)
        failures += outside
    scope: Scope = "none" if course is None else "global" if all(part.proved for part in parts) else "local"
    return Certificate(
        verdict="stable" if scope == "global" else "inconclusive" if known else "not proved",
        scope=scope,
        rate=None if course is None else rate,
        period=None if course is None else longest,
        margin=MARGIN,
        parts=parts,
        proof=_proof(chain, scope, parts, course),
        failures=failures,
        evidence=(),
        sampling=None,
        digest=digest,
        course=course,
    )


def _around(certificate: PartCertificate, part: ActingSkill) -> PartCertificate:
    """Return the certificate with the radius within which a coupled part is proved, if it is."""
    if not certificate.coupling or certificate.coordinates or certificate.rate is None:
        return certificate
    return replace(certificate, radius=coupled_radius(part))


def _parts_suffice(skill: Skill) -> bool:
    """Return whether the stability of each part alone makes the whole globally stable."""
    members = skill.acting_parts
    if not skill.reselects or len(members) == 1:
        return True
    first = members[0]
    alike = all(part.form == first.form and part.coordinates == first.coordinates for part in members)
    return len(skill.attractors) == 1 and alike


def _every_attractor_has_a_radius(skill: Skill, parts: tuple[PartCertificate, ...]) -> bool:
    attractors = [tuple(part.attractor.tolist()) for part in skill.acting_parts]
    certified = {place for place, part in zip(attractors, parts, strict=True) if part.radius is not None}
    return certified == set(attractors)


def _proof(
    skill: Skill, scope: Scope, parts: tuple[PartCertificate, ...], course: Course | None = None
) -> tuple[str, ...]:
    """Say what is proved, part by part and for the whole."""
    unit = skill.space.unit
    sentences: list[str] = []
    if isinstance(skill, ChainedSkill):
        sentences += (
            () if course is None else told(skill, course, _from_where(skill, scope), local=scope == "local")
        )
    elif scope == "global":
        sentences.append(_global_statement(skill))
    for part in parts:
        name = "It" if len(parts) == 1 else f"Part {part.part}"
        known = part.proved or part.radius is not None
        if known and part.rate is not None and part.period is not None:
            bent = ", in its coordinates," if skill.acting_parts[part.part - 1].coordinates.links else ""
            sentences.append(
                f"{name} shrinks {_shrunk(bent, part)}, at every controller period up to "
                f"{at_least(part.period)} s ({least_frequency(part.period)} Hz or faster): exact for all "
                f"{len(part.components)} components."
            )
        if part.radius is not None and part.coupling:
            sentences.append(
                f"From within {at_least(part.radius)} {unit} of its attractor, angles counted by the "
                "characteristic length, every motion ends there."
            )
        elif part.radius is not None:
            sentences.append(
                f"From within {at_least(part.radius)} {unit} of its attractor part {part.part} alone acts, "
                f"and every motion ends there."
            )
    if scope == "global" and skill.kind == "merged":
        sentences.append(
            "The same is proved for all weights of its parts: all of their components contract under one P."
        )
    return tuple(sentences)


def _shrunk(bent: str, part: PartCertificate) -> str:
    """Say which distances to the attractor shrink, and how fast."""

    def at(rate: float | None) -> str:
        return f"at {at_least(rate or 0.0)} 1/s or faster"

    if not part.blocks:
        return f"the P-distance to its attractor{bent} {at(part.rate)}"
    position, orientation = part.blocks
    return (
        f"the P-distance of the position to its attractor{bent} {at(position.rate)}, and the angle to the "
        f"orientation there {at(orientation.rate)}"
    )


def _from_where(skill: Skill, scope: Scope) -> str:
    """Say from where motions are proved."""
    if scope == "local":
        return "within the radius of its first part"
    if len(skill.space.blocks) > 1:
        return "every position and every orientation but those exactly 180° from the target's"
    return "everywhere"


def _global_statement(skill: Skill) -> str:
    everywhere = _from_where(skill, "global")
    if len(skill.acting_parts) == 1 and skill.kind != "combined":
        return f"Every motion converges to the attractor exponentially, from {everywhere}."
    if not skill.reselects:
        seam = "" if everywhere == "everywhere" else f" Motions of a part converge from {everywhere}."
        return (
            "Every motion with finitely many disturbances converges exponentially to the attractor of the "
            "part that acts after the last of them: the part i whose βᵢ pᵢ is largest where that disturbance "
            "left the state, or, undisturbed, at the start. That region is the basin of its attractor." + seam
        )
    return (
        f"Every motion converges to the one attractor exponentially, from {everywhere}: whichever part acts, "
        "the same P-distance shrinks."
    )


def _open_question(skill: Skill) -> str:
    if len(skill.attractors) == 1:
        return (
            "The parts have different P or coordinates, and the instantaneous gate may switch between them "
            "for ever: no common measure of distance is known to shrink. Combine with common ones, or "
            "latched."
        )
    return (
        "The parts have different attractors, and the instantaneous gate may hold a motion on the border "
        "of two regions: nothing is proved away from the attractors. The latched gate has a proof."
    )


def _evidence(sampling: Sampling, unit: str) -> str:
    time = f"{sampling.duration:.3g} s"
    tried = f"{sampling.arrived} of {sampling.starts} sampled motions arrived within {time}"
    if sampling.witness is None:
        return f"{tried}; none was found that reaches no attractor. This is evidence, not proof."
    start = ", ".join(f"{value:.6g}" for value in sampling.witness)
    return f"{tried}; the motion from ({start}) {unit} reached no attractor and was coming nearer to none."
