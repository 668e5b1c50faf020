"""Reading of single files, safely: nothing is unpickled, and everything is checked.

layout: which files a folder holds; image: silhouettes; mesh_file: meshes; fabrics, protocol: tables beside the data;
measure: profiles and content hashes, cached.
"""
