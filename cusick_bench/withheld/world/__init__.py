"""The true world behind withheld cases; it shares no law of an effect with the package.

fabric: true fabrics; true_case: scenes and pictures of one case; scene, scene_system, drop: one drape;
photograph: its picture; placed_disc, fields: meshes and random fields; laws: true laws of effects.
"""
