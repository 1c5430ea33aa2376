"""The flags of training and of the dataset readers explain themselves."""

from dataclasses import fields

import pytest
from docstring_parser import parse_from_object  # tyro reads the help of flags by it

from m3depth.datasets.config import DataConfig
from m3depth.training.augmentation import AugmentConfig
from m3depth.training.config import TrainConfig
from m3depth.training.loss_config import LossConfig


@pytest.mark.parametrize("config", [TrainConfig, DataConfig, AugmentConfig, LossConfig])
def test_the_help_of_every_flag_is_made_of_whole_sentences(config) -> None:
    texts = {entry.arg_name: (entry.description or "").strip() for entry in parse_from_object(config).params}
    assert texts.keys() == {field.name for field in fields(config)}
    assert [name for name, text in texts.items() if not text[0].isupper() or not text.endswith(".")] == []
