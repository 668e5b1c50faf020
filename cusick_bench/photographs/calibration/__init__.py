"""Where the plate is, seen from the camera: from pictures of the printed board or of the bare plate."""
