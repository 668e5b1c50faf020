"""Kinds of irregularities that an audit can find, and their meanings."""

from dataclasses import dataclass

KINDS = {
    # files and folders
    "space-in-path": "a folder's name holds a space",
    "folder-misspelt": "a folder's name is misspelt, e.g. silouettes",
    "folder-inconsistent": "sample folders are named in two ways, e.g. `Sample 1` and `Sample_10`",
    "file-inconsistent": "image and mesh of one drape are named in two ways, e.g. Observation and Obs",
    "fabric-misnamed": "a file is named after another fabric than its folder",
    "sample-misnamed": "a file is named after another sample than its folder",
    "no-capture-number": "file names hold no capture number; captures are taken as 1",
    "number-zero": "a fabric, sample, capture or observation has the number 0; numbers begin at 1",
    "duplicate-name": "several files claim the same fabric, sample and capture",
    "unused-file": "files that are no part of the layout",
    "outside-link": "a link that leads out of the folder; not followed",
    "no-permission": "a file or folder that may not be read",
    # captures
    "missing-capture": "a sample has fewer captures than the others of its fabric",
    "extra-capture": "a capture or observation that most samples of its fabric, or the protocol's `captures`, lack",
    "side-unknown": "face up or down cannot be told: meshes contradict the capture numbers, or the number is unknown",
    "mixed-faces": "a set mixes drapes with either face up",
    "mixed-observations": "a set mixes observations at different times",
    # images
    "unreadable-image": "not an image that can be decoded",
    "image-too-large": "a file or an image far larger than any silhouette; not decoded",
    "image-size": "another size than the protocol's",
    "image-colour": "channels differ: a photograph rather than a silhouette",
    "image-grey": "not black and white: parts away from the outline are neither cloth nor background",
    "empty-image": "no cloth: all background",
    "full-image": "all cloth: no background",
    "inverted-image": "cloth and background are exchanged",
    "two-blobs": "a second object beside the cloth",
    "specks": "small separate objects beside the cloth, taken for background",
    "hole": "background inside the cloth",
    "touches-border": "the cloth is cut by the image's border",
    "off-centre": "the silhouette crosses the plate's edge, but would hold the plate if shifted",
    "shrunken-image": "the silhouette is too small to hold the plate: wrong scale",
    "radius-beyond-cloth": "the silhouette reaches farther than the flat cloth",
    "far-off-centre": "the cloth lies so far from the plate's axis that it could not lie on the plate",
    "duplicate-image": "two identical image files",
    "named-copy": "an image of a named set that is identical to a capture of a fabric",
    "named-near-copy": "an image of a named set that nearly equals a capture of a fabric",
    "named-unmatched": "an image of a named set that resembles no capture of its fabric",
    # meshes
    "no-mesh": "a silhouette without mesh",
    "no-silhouette": "a mesh without silhouette",
    "unreadable-mesh": "not a triangle mesh in Wavefront OBJ form",
    "mesh-too-large": "a file far larger than any drape's mesh; not read",
    "mesh-topology": "other numbers of vertices and faces than most meshes of the data set",
    "mesh-units": "a mesh whose size is no cloth's in metres",
    "mesh-rotated": "a mesh that fits its silhouette only after a rotation about z",
    "mesh-other-capture": "a mesh that belongs to another capture's silhouette",
    "mesh-matches-none": "a mesh that fits no silhouette of its sample",
    "duplicate-mesh": "two identical mesh files",
    # tables
    "density-missing": "no areal density is known for a fabric",
    "thickness-missing": "no thickness is known for a fabric",
    "fabrics-invalid": "fabrics.csv is malformed or holds an impossible value",
    "fabrics-unused": "fabrics.csv names a fabric that is not there, or has a column that is not used",
    "protocol-invalid": "protocol.json is malformed or holds an impossible value",
    "protocol-centre": "most silhouettes lie to the same side of `centre_px`",
    "protocol-scale": "most silhouettes are too large or too small for `px_per_m`",
    "protocol-unknown-key": "protocol.json holds a key that is not used",
    "checksum": "a file differs from its SHA-256 in sha256.json, is missing, or is not listed there",
}  # fmt: skip


@dataclass(frozen=True, order=True)
class Irregularity:
    """One thing that is not as the layout promises.

    Attributes:
        path: File or folder relative to the data set's root, "." for the root itself.
        kind: A key of `KINDS`.
        detail: What was found.
    """

    path: str
    kind: str
    detail: str

    def __post_init__(self) -> None:
        assert self.kind in KINDS, self.kind
