"""What is irregular in a folder of drapes.

audit: `audit`, `Audit`; files, images, meshes: the checks; limits: which silhouettes are impossible.
"""
