"""Material laws, one file each, for compiled kernels.

paper: derives from an energy; published: the published program's, quirks included;
tables: what the stiffness tables sample; vectors: compilation and 3-vectors, shared by all kernels.
"""
