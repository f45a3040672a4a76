"""Video layouts to images, silhouettes, cameras and rays; matting; synthetic scenes."""
