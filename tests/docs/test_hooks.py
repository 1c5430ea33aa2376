"""The hooks of the site: links between its pages, links to pictures, and the check for dead links."""

from types import SimpleNamespace

import pytest


@pytest.fixture
def rendered(hooks):
    """A function that returns the Markdown of a page after the hooks."""
    from mkdocs.structure.files import File, Files, InclusionLevel

    names = ["concepts/network.md", "results/depth/rows.json", "reference/index.md", "reference/commands-nav.md"]
    files = Files([File(name, "docs", "site", use_directory_urls=False) for name in names])
    files.append(File("receptive_field.py", "docs", "site", False, inclusion=InclusionLevel.EXCLUDED))

    def render(text: str, page: str) -> str:
        return hooks.on_page_markdown(text, SimpleNamespace(file=SimpleNamespace(src_uri=page)), None, files)

    return render


@pytest.mark.parametrize(
    ("link", "shown"),
    [
        ("[config.py](../../m3depth/network/config.py)", "`m3depth/network/config.py`"),
        ("[`config.py`](../../m3depth/network/config.py)", "`m3depth/network/config.py`"),
        ("[network/config.py](../../m3depth/network/config.py)", "`m3depth/network/config.py`"),
        ("[rivals](../../m3depth/rivals)", "`m3depth/rivals`"),
        ("[the settings](../../m3depth/network/config.py)", "the settings"),
        ("[fig.py](../../m3depth/network/config.py)", "fig.py"),
        ("[receptive_field.py](../receptive_field.py)", "`docs/receptive_field.py`"),
        ("[this file](../receptive_field.py)", "this file"),
    ],
)
def test_a_link_to_a_source_file_becomes_its_label_or_its_path(link, shown, rendered):
    assert rendered(f"See {link}.", "concepts/architecture.md") == f"See {shown}."


@pytest.mark.parametrize(
    ("link", "shown"),
    [
        ("[the network](../concepts/network.md#size)", "[the network](../concepts/network.md#size)"),
        ("[rows](depth/rows.json)", "[rows](depth/rows.json)"),
        ("[the card](../../m3depth/weights/MODEL_CARD.md)", "[the card](model-card.md)"),
        ("[an example](../../examples/one_episode.py)", "[an example](../examples/one_episode.md)"),
        ("[MarsNav-v0](../../envs/mars_nav.py)", "[MarsNav-v0](../reference/marsnav-v0.md)"),
        ("[nothing](nothing.md)", "[nothing](nothing.md)"),
        ("[others](https://zenodo.org/records/14286916)", "[others](https://zenodo.org/records/14286916)"),
    ],
)
def test_a_link_to_a_page_or_a_file_of_the_site_stays_a_link(link, shown, rendered):
    assert rendered(link, "results/depth.md") == shown


def test_code_that_names_a_page_made_from_the_code_becomes_a_link_to_it(rendered):
    text = "`reference/commands-nav` `reference/no-page` [`reference/index`](index.md)\n\n```\n`reference/index`\n```\n"
    linked = text.replace("`reference/commands-nav`", "[`reference/commands-nav`](commands-nav.md)")
    assert rendered(text, "reference/index.md") == linked


def test_a_picture_becomes_a_link_to_its_file_unless_it_is_in_a_link(hooks):
    picture, other = '<img alt="A map" src="../images/map.jpg" />', '<a href="x.html"><img alt="" src="x.png"></a>'
    inside = '<p><img alt="" src="data:image/png;base64,AA=="></p>'
    html = hooks.on_page_content(f"<p>{picture}</p>{other}{inside}", None, None, None)
    assert html == f'<p><a class="picture" href="../images/map.jpg">{picture}</a></p>{other}{inside}'


def test_each_dead_link_of_the_site_is_a_warning_and_others_are_none(dead_links, hooks, tmp_path, caplog):
    (tmp_path / "guides").mkdir()
    (tmp_path / "index.html").write_text(
        '<meta name="viewport"><a href="#viewport"></a><a name="old"></a><a href="#old"></a>'
        '<h1 id="top">Home</h1><a href="#top"></a><a href="guides/a%20b.html#part"></a><img src="map.jpg">'
        '<a href="guides/a%20b.html#parts"></a><a href="guides"></a><a href="https://example.org/x"></a>'
    )
    (tmp_path / "guides" / "a b.html").write_text(
        '<h2 id="part"></h2><a href="../index.html"></a><a href="c.py"></a>' + '<script src="/x"></script>'
    )
    (tmp_path / "404.html").write_text('<a href="/none.html"></a>')
    dead = [
        "guides/a b.html: /x",
        "guides/a b.html: c.py",
        "index.html: #viewport",
        "index.html: guides",
        "index.html: guides/a%20b.html#parts",
        "index.html: map.jpg",
    ]
    assert sorted(dead_links.dead_links(tmp_path)) == dead
    hooks.on_post_build(SimpleNamespace(site_dir=str(tmp_path)))
    assert [record.levelname for record in caplog.records] == ["WARNING"] * len(dead)
    assert all(record.name.startswith("mkdocs.") for record in caplog.records)  # a strict build counts those


def test_a_search_finds_the_glossary_first(hooks):
    from mkdocs.structure.files import Files

    page = SimpleNamespace(file=SimpleNamespace(src_uri="start/glossary.md"), meta={})
    assert hooks.on_page_markdown("# Glossary", page, None, Files([])) == "# Glossary"
    assert page.meta == {"search": {"boost": 3}}
