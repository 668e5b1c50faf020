"""Where the cloth ends: ground and cloth told apart in the plane of the plate, with a confidence."""
