"""Effects of the camera and of how its picture is made."""
