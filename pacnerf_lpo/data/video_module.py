"""A video as Lightning wants it; what reads a finished run does without, for Lightning takes seconds to import."""

from typing import Any

from pytorch_lightning import LightningDataModule, Trainer
from torch.utils.data import DataLoader

from pacnerf_lpo.data.video_data import VideoData


class VideoModule(VideoData, LightningDataModule):
    """A multi-view video that a Trainer draws its batches from."""

    def setup(self, stage: str) -> None:
        """Called by Lightning before a phase starts."""
        self.prepare()

    def train_dataloader(self) -> DataLoader:
        """The running phase decides its batches; they are handed on as they are."""
        if not isinstance(self.trainer, Trainer):
            raise RuntimeError("VideoModule has no trainer; hand it to Trainer.fit(phase, datamodule=...)")
        phase: Any = self.trainer.lightning_module
        return DataLoader(phase.batches(self), batch_size=None)
