"""
Sphinx: theme, docstrings, and how names in docstrings become links. Sources are laid out by
stage.py.
"""

import importlib
import os
import re
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path

from docutils import nodes
from latex2mathml.converter import convert
from numpydoc.xref import DEFAULT_LINKS
from pygments.lexers.special import TextLexer
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.nodes import make_refnode

import pymantaray
from pymantaray.collection import collect_rarely
from pymantaray.records.glossary import GLOSSARY

collect_rarely()  # a build keeps almost all that it makes
HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
from reference_pages import FOLDERS, column_unit, quantity

project = "MantaRay"
author = "The MantaRay developers"
version = release = pymantaray.__version__
html_title = f"{project} {version}"

extensions = [
    "myst_nb",  # loads myst_parser
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx.ext.viewcode",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
]
sphinx_gallery_conf = {
    "examples_dirs": str(HERE.parents[1] / "examples" / "gallery"),
    "gallery_dirs": "scripts",
    "filename_pattern": "/plot_",
    "within_subsection_order": "gallery_order.BySubject",
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "abort_on_example_error": True,
}
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # s, of a cell
exclude_patterns = ["scripts/*.ipynb"]  # made by the gallery for download, not pages
root_doc = "index"
default_role = "py:obj"
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
templates_path = [str(HERE / "templates")]
autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_class_signature = "mixed"
numpydoc_show_class_members = False
numpydoc_xref_param_type = True
if os.environ.get("READTHEDOCS") == "True":
    intersphinx_mapping = {
        "python": ("https://docs.python.org/3/", None),
        "numpy": ("https://numpy.org/doc/stable/", None),
        "pandas": ("https://pandas.pydata.org/docs/", None),
        "scipy": ("https://docs.scipy.org/doc/scipy/", None),
        "xarray": ("https://docs.xarray.dev/en/stable/", None),
    }
else:
    DEFAULT_LINKS.clear()  # which lead into the network, and so does intersphinx
numpydoc_xref_aliases = {
    name: f"pymantaray.{folder}.{name}"
    for folder in FOLDERS
    for name in importlib.import_module(f"pymantaray.{folder}").__all__
}
numpydoc_xref_ignore = "all"  # other words of a type

html_theme = "pydata_sphinx_theme"
html_context = {"default_mode": "auto"}
html_static_path = [str(HERE / "static")]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_math_renderer = "mathml"
html_theme_options = {
    "logo": {"text": project},
    "navbar_end": ["theme-switcher"],
    "header_links_before_dropdown": 5,
    "show_toc_level": 2,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "back_to_top_button": False,
}
html_sidebars = {"index": [], "changelog": [], "figures/README": []}
project_copyright = "the MantaRay developers, MIT licence"


def describe_columns(_app, what, _name, obj, _options, lines):
    """List the columns of a record, which are declared and not written in its docstring."""
    if what != "class" or not is_dataclass(obj):
        return
    columns = [f for f in fields(obj) if "dims" in f.metadata]
    if columns and "Attributes" not in lines:
        lines += ["", "Attributes", "----------"]
        for f in columns:
            m = f.metadata
            lines += [
                f"{f.name} : ndarray, shape ({', '.join(m['dims'])})",
                f"    {m['long_name'].capitalize()}. [{column_unit(f.name, m['units'])}]",
            ]


def describe_data(_app, what, name, _obj, _options, lines):
    """Give a constant the words beneath it where it is defined, not where it is exported from."""
    folder, _, last = name.rpartition(".")
    if what != "data":
        return
    below = [m for m in sys.modules if m.startswith(f"{folder}.")]
    for module in [m for m in below if last in vars(sys.modules[m])]:
        words = ModuleAnalyzer.for_module(module).find_attr_docs().get(("", last))
        if words:
            lines[:] = words


def resolve(app, env, node, contnode):
    """
    Link a name to what is documented under it, whichever module the docstring or annotation has it
    from, and a package to its page.
    """
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"].lstrip("~.").removesuffix("()")
    folder = target.removeprefix("pymantaray.")
    if folder != target and folder in FOLDERS:
        page = f"reference/api/{folder}"
        return make_refnode(app.builder, node["refdoc"], page, "", contnode, target)
    objects = env.domains["py"].objects
    ends = [name for name in objects if name == target or name.endswith(f".{target}")]
    last = target.rpartition(".")[2]
    if not ends and target.startswith("pymantaray."):
        ends = [name for name in objects if name.rpartition(".")[2] == last]
    if len({name.rpartition(".")[2] for name in ends}) != 1:
        return None
    entry = objects[min(ends, key=lambda name: (name.count("."), name))]
    name = min(ends, key=lambda name: (name.count("."), name))
    return make_refnode(app.builder, node["refdoc"], entry.docname, entry.node_id, contnode, name)


def link_quantities(app, doctree, docname):
    """
    Link parameters, columns and keys of the reference to their entries in the nomenclature, which
    get anchors.
    """
    if docname == "nomenclature":
        for row in doctree.findall(lambda node: isinstance(node, nodes.row) and len(node) == 5):
            for name in row[1].findall(nodes.literal):
                anchor = nodes.make_id(name.astext())
                if not any(anchor in node["ids"] for node in doctree.findall(nodes.Element)):
                    name["ids"].append(anchor)
    if not docname.startswith("reference/"):
        return
    terms = [
        strong for term in doctree.findall(nodes.term) for strong in term.findall(nodes.strong)
    ]
    keys = [row[0].next_node(nodes.literal) for row in doctree.findall(nodes.row)]
    for names in (
        *terms,
        *(key for key in keys if key is not None and key.parent.tagname != "reference"),
    ):
        parts = re.split(r"(, )", names.astext())
        names[:] = [link_quantity(app, docname, part) for part in parts]


def link_quantity(app, docname, name):
    """Name as a link to its entry in the nomenclature, if there is one."""
    entry = quantity(name)
    if entry is None:
        return nodes.Text(name)
    place = app.builder.get_relative_uri(docname, "nomenclature")
    return nodes.reference("", name, internal=True, refuri=f"{place}#{nodes.make_id(entry)}")


TERMS = {
    "shadow": r"shadows?(?: zones?)?",
    "weak": r"weak",
    "blocked": r"blocked",
    "condition": r"(?<!boundary )(?<!initial )conditions?",
    "NEES": r"NEES",
    "lower bound": r"(?:posterior )?Cramér-Rao bound|lower bounds?",
}
"""Words of the glossary that pages explain where they first occur, and how pages write them."""
SKIPPED = (
    nodes.title,
    nodes.reference,
    nodes.literal,
    nodes.literal_block,
    nodes.math,
    nodes.math_block,
    nodes.term,
    nodes.caption,
)
OWN_WORDS = ("changelog", "reference/glossary", "reference/api/")
"""Pages without tooltips: the glossary itself, and pages made from code and commits."""


def explain_terms(app, doctree, docname):
    """
    Link the first occurrence of each term of the glossary on a page to its entry, with the meaning
    as tooltip.
    """
    if docname.startswith(OWN_WORDS):
        return
    left = dict(TERMS)
    for text in list(doctree.findall(nodes.Text)):
        if not left:
            return
        above, parent = [], text.parent
        while parent is not None:
            above.append(parent)
            parent = parent.parent
        if not any(isinstance(node, SKIPPED) for node in above):
            parts = [text]
            for word, pattern in list(left.items()):
                match = re.search(rf"\b(?:{pattern})\b", parts[-1], re.IGNORECASE)
                if match:
                    parts[-1:] = [
                        nodes.Text(parts[-1][: match.start()]),
                        term_link(app, docname, word, match[0]),
                        nodes.Text(parts[-1][match.end() :]),
                    ]
                    del left[word]
            if len(parts) > 1:
                text.parent.replace(text, parts)


def term_link(app, docname, word, written):
    """Link to a word's entry in the glossary; pointing at it shows the meaning."""
    page, anchor = app.env.domains["std"].objects["term", word]
    place = app.builder.get_relative_uri(docname, page)
    link = nodes.reference(
        "",
        written,
        internal=True,
        refuri=f"{place}#{anchor}",
        reftitle=GLOSSARY[word],
        classes=["term"],
    )
    return link


def mathml(display):
    """Write a formula as MathML, which browsers show without a script."""

    def visit(self, node):
        formula = convert(node.astext(), display="block" if display else "inline")
        self.body.append(f'<p class="equation" tabindex="0">{formula}</p>' if display else formula)
        raise nodes.SkipNode

    return visit


EMPTY_HEAD = re.compile(r"<th(?: class=\"head\")?>(?:<p>\s*</p>)?</th>")


def name_for_screen_readers(_app, _page, _template, context, _doctree):
    """
    Write empty heads of tables as cells, and name the buttons that open a section of the contents.
    """
    context["body"] = EMPTY_HEAD.sub("<td></td>", context.get("body", ""))
    contents = context.get("generate_toctree_html")  # of the theme
    if contents is None:
        return

    def named(*args, **options):
        tree = contents(*args, **options)
        for button in tree.find_all("summary") if hasattr(tree, "find_all") else ():
            button["aria-label"] = f"Pages of {button.find_parent('li').a.get_text(strip=True)}"
        return tree

    context["generate_toctree_html"] = named


def setup(app):
    """Connect the above; numpydoc reads docstrings after the columns are in them."""
    app.connect("autodoc-process-docstring", describe_columns, priority=100)
    app.connect("autodoc-process-docstring", describe_data, priority=100)
    app.connect("missing-reference", resolve)
    app.connect("doctree-resolved", link_quantities)
    app.connect("doctree-resolved", explain_terms)
    app.connect("html-page-context", name_for_screen_readers, priority=900)  # after the theme
    app.add_lexer("csv", TextLexer)
    app.add_html_math_renderer(
        "mathml", (mathml(display=False), None), (mathml(display=True), None)
    )
