"""LeRobot's folders, of versions 2 and 3: read, checked and kept with videos."""
