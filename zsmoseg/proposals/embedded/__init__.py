"""Objects without networks: superpixels that stand out from the motion of the camera, followed through a shot."""
