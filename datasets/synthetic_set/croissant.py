"""A description of the `synthetic` set for other programs.

References:
    Croissant metadata format 1.0, MLCommons, 2024; checked by `mlcroissant validate --jsonld croissant.json`.
"""

from pathlib import Path
from typing import Any

NAME = "cusick-bench-synthetic"
_FABRICS = "fabrics.csv"
_COLUMNS = {
    "fabric": ("Number of the fabric.", "sc:Integer"),
    "areal_density_kg_m2": ("Areal density [kg/m2].", "sc:Float"),
    "thickness_m": ("Thickness [m].", "sc:Float"),
}
_MEDIA_TYPES = {
    ".png": "image/png",
    ".csv": "text/csv",
    ".json": "application/json",
    ".gz": "application/gzip",
}
# Prefixes and terms as the standard has them.
_CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileProperty": "cr:fileProperty",
    "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}


def croissant(files: dict[str, str]) -> dict[str, Any]:
    """Describes the set for other programs.

    Args:
        files: SHA-256 of every file, by path below the folder of the set.

    Returns:
        A document of the form Croissant 1.0: the files, and the table of fabrics as records.
    """
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "name": NAME,
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "description": "Simulated Cusick drapes of five cloths of known stiffness: 12 samples x 2 faces x 2 captures.",
        "license": "https://spdx.org/licenses/Apache-2.0",
        "version": "1.0.0",
        "distribution": [
            {
                "@type": "cr:FileObject",
                "@id": name.replace(" ", "_"),  # identifiers hold no blanks in Croissant
                "name": name,
                "contentUrl": name,
                "encodingFormat": _MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream"),
                "sha256": digest,
            }
            for name, digest in files.items()
        ],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "fabrics",
                "name": "fabrics",
                "field": [
                    {
                        "@type": "cr:Field",
                        "@id": f"fabrics/{column}",
                        "name": column,
                        "description": description,
                        "dataType": kind,
                        "source": {"fileObject": {"@id": _FABRICS}, "extract": {"column": column}},
                    }
                    for column, (description, kind) in _COLUMNS.items()
                ],
            }
        ],
    }
