"""Video layouts to images, silhouettes, cameras and rays; matting; synthetic scenes."""

from pacnerf_lpo.data.video_module import VideoData

__all__ = ["VideoData"]
