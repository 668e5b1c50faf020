"""Material laws, one file each, for compiled kernels.

plate: an orthotropic Kirchhoff-Love plate; paper: hinges, with an energy; published: the published program's, quirks
included; tables: samples of the stiffness tables; vectors: compilation and 3-vectors, shared by all kernels.
"""
