"""Made-up diagnoses of every verdict, as documents that pages and graphs are drawn from."""

import json

import numpy as np

from cusick_bench.diagnosis.document.model import DiagnosisDocument
from cusick_bench.sim.effects import registered

STAGES = ("material", "boundary", "contact", "history", "imaging", "none", "unknown")


def drapes(shift: float, folds: int) -> list[dict]:
    """Profiles of three drapes on both faces as the camera sees them: folds, and a cloth off centre [m]."""
    angle = np.deg2rad(np.arange(360))
    generator = np.random.default_rng(folds)
    made = []
    for sample, side in ((sample, side) for sample in (1, 2, 3) for side in ("up", "down")):
        phase = generator.uniform(0, 2 * np.pi)
        radii = 0.12 + shift * np.cos(angle - 0.7) + 0.012 * np.cos(folds * angle - phase)
        made.append({"sample": sample, "side": side, "radii_m": radii.round(6).tolist()})
    return made


def made_up_profiles() -> dict[str, list[dict]]:
    """Data with an off-centre cloth, the base model, and the base model with that cause."""
    return {"data": drapes(0.008, 7), "base": drapes(0.0, 6), "effect": drapes(0.007, 8)}


def causes(**probability: float) -> list[dict]:
    """Causes with their registered parameters at typical values."""
    made = []
    for name, share in sorted(probability.items(), key=lambda item: -item[1]):
        known = registered().get(name := name.replace("_", "-"))
        parameters = {p.name: {"value": p.typical or 40.0, "unit": p.unit} for p in known.parameters} if known else {}
        made.append({"effect": name, "class": known.kind if known else "", "probability": share})
        made[-1] |= {"parameters": parameters, "summary": known.summary if known else ""}
    return made


def patch_map() -> list[list[float]]:
    """A patch around 67 degrees near the rim."""
    middle = 67.0 - (np.arange(16) + 0.5) * 22.5
    near = np.exp(-0.5 * (np.minimum(np.abs(middle), 360 - np.abs(middle)) / 18) ** 2)
    weights = np.array([0.05, 0.3, 1.0, 0.8])[:, None] * near + 0.004
    return (weights / weights.sum()).tolist()


def document(profiles: dict, verdict: str = "effect") -> dict:
    """A plausible diagnosis of each verdict."""
    made = json.loads(json.dumps(BASE)) | {"verdict": verdict, "profiles": dict(profiles)}
    if verdict == "effect":
        made["causes"] = causes(off_centre=0.83, camera_offset=0.09, plate_tilt=0.04, unknown=0.02, none=0.001)
        made["set90"] = ["off-centre", "camera-offset"]
        made["headline"] = "The cloth lay about 8 mm off the plate's centre, towards 40° (83 %)."
        made["where"] |= {"kind": "direction", "why_not": "it acts along a direction, not in a place"}
        made["closure"] = {"effect": "off-centre", "fraction": 0.78, "ci90": [0.55, 0.93]}
        made["gap"]["effect"] = 0.021
    elif verdict == "patch":
        made |= {"verdict": "effect", "set90": ["local-stiff-patch"]}
        made["causes"] = causes(local_stiff_patch=0.92, local_mass_patch=0.05, unknown=0.01, none=0.004)
        made["where"] |= {"map": patch_map(), "kind": "patch", "localisable": True, "why_not": ""}
        made["where"] |= {"angle_deg": [45.0, 90.0], "radius_m": [0.12, 0.15]}
        made["where"] |= {"null_map": np.full((4, 16), 1 / 64).tolist(), "null_p": 0.01}
        made["where"] |= {"resolution": {"angle_deg": 67.5, "radius_m": 0.03}}
        made["closure"] = {"effect": "local-stiff-patch", "fraction": 0.31, "ci90": [-0.12, 0.61]}
        made["gap"]["effect"] = 0.05
    elif verdict == "ambiguous":
        made["causes"] = causes(
            plate_radius=0.33, cut_size=0.29, camera_scale=0.22, threshold=0.12, unknown=0.02, none=0.01
        )
        made["set90"] = ["plate-radius", "cut-size", "camera-scale", "threshold"]
        made["indistinguishable"] = [{"effects": made["set90"], "why": "all make every radius larger by a like share"}]
        made["closure"] = {"effect": "plate-radius", "fraction": 0.64, "ci90": [0.4, 0.82]}
        made["gap"]["effect"] = 0.03
    elif verdict == "unknown":
        made["causes"] = causes(unknown=0.81, stiffness_field=0.06, self_contact=0.05, none=0.002)
        made |= {"set90": ["unknown", "stiffness-field", "self-contact"], "headline": ""}
        made["profiles"].pop("effect")
    elif verdict == "none":
        made["causes"] = causes(none=0.9, unknown=0.03, creep=0.02, grain_skew=0.02)
        made |= {"set90": ["none"], "headline": "", "statistics": made["statistics"][3:], "next": []}
        made["gap"] = {"base": -0.0021, "floor": 0.009, "p": 0.62, "effect": None, "groups": made["gap"]["groups"]}
        made["gap"]["groups"] = {name: {"gap": g["floor"] * 0.7, "floor": g["floor"]} for name, g in groups().items()}
        made["profiles"].pop("effect")
    total = {stage: 0.0 for stage in STAGES}
    for cause in made["causes"]:
        total[cause["class"] or cause["effect"]] += cause["probability"]
    made["where"]["stage"] = total
    return made


def groups() -> dict[str, dict[str, float]]:
    gaps = {"size": 0.02, "radii": 0.06, "depth": 0.03, "number": 0.01, "spectrum": 0.04, "harmonics": 0.31}
    return {name: {"gap": gap, "floor": 0.011 + 0.1 * gap} for name, gap in gaps.items()} | {
        "envelope": {"gap": -0.004, "floor": 0.012}
    }


def statistic(name: str, group: str, unit: str, values: tuple[float, float, float, float], z: float) -> dict:
    up, down, base, effect = values
    return {"name": name, "group": group, "unit": unit, "up": up, "down": down, "base": base, "effect": effect, "z": z}


BASE = {
    "fabric": "Fabric 7 (cotton <twill>)",
    "headline": "Something makes every drape too wide by 2 %.",
    "gap": {"base": 0.0874, "floor": 0.0126, "p": 0.0004, "effect": None, "groups": groups()},
    "where": {
        "map": np.full((4, 16), 1 / 64).tolist(),
        "kind": "",
        "angle_deg": None,
        "radius_m": None,
        "localisable": False,
        "why_not": "no single cause is named",
    },
    "closure": {"effect": None, "fraction": None, "ci90": None},
    "next": [
        {
            "name": "rotate by 90 degrees",
            "what": "Drape samples turned by 90 degrees on the plate: what belongs to the cloth turns with it.",
            "bits": 0.62,
            "about": ["off-centre", "plate-tilt", "camera-offset"],
        },
        {
            "name": "photograph a ruler",
            "what": "Photograph a ruler on the plate: it shows the camera's scale, place and edge.",
            "bits": 0.2,
            "about": ["camera-offset"],
        },
    ],
    "base": {"bending": -6.8, "anisotropy": 0.2, "bias": 0.0, "growth": 0.1, "shear": 4.2, "laying": 0.0, "rest": 0.1},
    "data": {"samples": 12, "captures": 48, "up": 24, "down": 24, "later": 24, "areal_density_kg_m2": 0.192},
    "statistics": [
        statistic("harmonic_1_real", "harmonics", "m", (0.0052, 0.0049, 0.0001, 0.0047), 9.4),
        statistic("harmonic_1_imaginary", "harmonics", "m", (0.0043, 0.0047, -0.0002, 0.0041), 8.8),
        statistic("skewness", "radii", "1", (0.31, 0.28, 0.12, 0.27), 3.1),
        statistic("area_dc", "size", "1", (0.48, 0.475, 0.471, 0.474), 1.2),
        statistic("folds", "number", "1", (7.4, 7.6, 7.5, 7.5), -0.4),
        statistic("roughness", "depth", "m/rad", (0.041, 0.043, 0.044, 0.044), -1.4),
    ],
    "indistinguishable": [],
    "notes": ["1 picture was left out: it shows another fabric."],
    "without": [],
    "made": {"version": "0.1.0", "command": "cusick-bench diagnose DATA --fabric 7", "atlas": "v1 (480 vertices)"},
}


NO_PROFILES = {"data": [], "base": [], "effect": []}
EMPTY = {"fabric": "", "verdict": "effect"}


def parsed(content: dict) -> DiagnosisDocument:
    return DiagnosisDocument.parse(json.dumps(content), "the test's document")


def small_document() -> dict:
    """A diagnosis without drapes."""
    return document(NO_PROFILES, "patch")
