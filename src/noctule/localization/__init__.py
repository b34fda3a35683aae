"""Where the vehicle is, as a depth camera in the room sees it."""
