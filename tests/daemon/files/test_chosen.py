"""Which model the loop runs."""

from pathlib import Path

import pytest
from tests.rigs.stepper import CONFIG, model

from dehyst.daemon.config import Config, load_config
from dehyst.daemon.files.chosen import (
    FILE,
    Accepted,
    choose_model,
    forget_accepted,
    write_accepted,
)
from dehyst.daemon.files.models import save_model
from dehyst.daemon.rings.records import model_digest
from dehyst.models.modelfile import dumps


@pytest.fixture
def config(tmp_path: Path) -> Config:
    save_model(model(), tmp_path / "model.toml")
    (tmp_path / "run").mkdir()
    text = CONFIG.replace('"none"', '"model.toml"')
    (tmp_path / "stage.toml").write_text(f'run_dir = "{tmp_path}/run"\n{text}')
    loaded = load_config(tmp_path / "stage.toml")
    assert Path(loaded.model.file).exists()
    return loaded


def accept(config: Config, text: str, **more: object) -> None:
    digest = model_digest(dumps(model()))
    fields: dict = {"offer": 1, "case": "c", "instead_of": digest, "model": text}
    write_accepted(config.directory, Accepted(**(fields | more)))


def test_an_accepted_model_is_the_one_until_it_is_forgotten(config: Config) -> None:
    assert choose_model(config)[1:] == (False, "")
    accept(config, dumps(model()))
    assert choose_model(config)[1]
    forget_accepted(config.directory)
    assert choose_model(config)[1:] == (False, "")


def test_who_changes_the_configured_file_means_that_one(config: Config) -> None:
    accept(config, dumps(model()), instead_of="another")
    _, accepted, says = choose_model(config)
    assert not accepted
    assert "has changed" in says


@pytest.mark.parametrize("damage", ["", "{", '{"offer": 1}', "[]", "\x00" * 50])
def test_a_damaged_choice_is_as_if_it_were_not_there(config: Config, damage: str) -> None:
    (config.directory / FILE).write_text(damage)
    assert choose_model(config)[1:] == (False, "")


def test_an_accepted_model_that_cannot_be_read_makes_way(config: Config) -> None:
    accept(config, "format = 99")
    _, accepted, says = choose_model(config)
    assert not accepted
    assert "cannot be used" in says
