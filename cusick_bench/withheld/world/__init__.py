"""The true worlds behind withheld cases; they share no law of an effect with the package.

registry, world: worlds by name, and what a world is; worlds: each of them; fabric: true fabrics; true_case: scenes and
pictures of one case; scene: one drape's circumstances; triangles, polar: ways to drape it; photograph: its picture;
fields: random fields; laws: true laws of effects.
"""
