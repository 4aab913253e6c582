//! PlotJuggler 3 layout: a tab for each page, two plots in a row. PlotJuggler computes tracking errors itself.

use std::collections::BTreeSet;
use std::io;

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesText, Event};
use shared_types::number::unit_shown;

use super::pages::Page;
use crate::plots::Plot;

type Xml = Writer<Vec<u8>>;

/// Curve colours, used in rotation; PlotJuggler draws a curve without a colour in black.
const COLOURS: [&str; 8] = [
    "#1f77b4", "#d62728", "#1ac938", "#ff7f0e", "#9467bd", "#17becf", "#bcbd22", "#f14cc1",
];
/// Number of plots in a row.
const IN_ROW: usize = 2;

/// Renders the layout. A recording name, given if the recording lies next to the layout, makes PlotJuggler load it too.
pub(super) fn text(pages: &[Page], recording: Option<&str>) -> io::Result<String> {
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 1);
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    element(&mut xml, "root", &[], |xml| {
        let window = [("name", "Main Window"), ("parent", "main_window")];
        element(xml, "tabbed_widget", &window, |xml| {
            pages.iter().try_for_each(|page| tab(xml, page))?;
            empty(xml, "currentTabIndex", &[("index", "0")])
        })?;
        empty(xml, "use_relative_time_offset", &[("enabled", "0")])?;
        if let Some(name) = recording {
            data_file(xml, name)?;
        }
        errors(xml, pages)
    })?;
    let text = String::from_utf8(xml.into_inner()).map_err(io::Error::other)?;
    Ok(text + "\n")
}

/// Writes an element with child elements.
fn element(
    xml: &mut Xml,
    name: &str,
    attributes: &[(&str, &str)],
    write: impl FnOnce(&mut Xml) -> io::Result<()>,
) -> io::Result<()> {
    let element = xml
        .create_element(name)
        .with_attributes(attributes.iter().copied());
    element.write_inner_content(write).map(drop)
}

fn empty(xml: &mut Xml, name: &str, attributes: &[(&str, &str)]) -> io::Result<()> {
    let element = xml
        .create_element(name)
        .with_attributes(attributes.iter().copied());
    element.write_empty().map(drop)
}

fn tab(xml: &mut Xml, page: &Page) -> io::Result<()> {
    let attributes = [("tab_name", &*page.title), ("containers", "1")];
    element(xml, "Tab", &attributes, |xml| {
        element(xml, "Container", &[], |xml| {
            let plots: Vec<Plot> = page.plots.iter().flat_map(with_error).collect();
            let rows: Vec<_> = plots.chunks(IN_ROW).collect();
            splitter(xml, "-", &rows, |xml, row| match row {
                [plot] => area(xml, plot),
                plots => splitter(xml, "|", plots, area),
            })
        })
    })
}

/// Writes parts of equal size, stacked (`-`) or side by side (`|`).
fn splitter<T>(
    xml: &mut Xml,
    orientation: &str,
    parts: &[T],
    write: impl Fn(&mut Xml, &T) -> io::Result<()>,
) -> io::Result<()> {
    let size = (1.0 / parts.len() as f64).to_string();
    let sizes = vec![&*size; parts.len()].join(";");
    let count = parts.len().to_string();
    let attributes = [
        ("orientation", orientation),
        ("count", &*count),
        ("sizes", &*sizes),
    ];
    element(xml, "DockSplitter", &attributes, |xml| {
        parts.iter().try_for_each(|part| write(xml, part))
    })
}

fn area(xml: &mut Xml, plot: &Plot) -> io::Result<()> {
    let title = match unit_shown(&plot.unit) {
        "" => plot.title.clone(),
        unit => format!("{} [{unit}]", plot.title),
    };
    element(xml, "DockArea", &[("name", &*title)], |xml| {
        let style = [
            ("mode", "TimeSeries"),
            ("style", "Lines"),
            ("line_width", "1.0"),
        ];
        element(xml, "plot", &style, |xml| {
            empty(xml, "limitY", &[])?;
            for (curve, colour) in plot.signals.iter().zip(COLOURS.iter().cycle()) {
                empty(xml, "curve", &[("name", &series(curve)), ("color", colour)])?;
            }
            Ok(())
        })
    })
}

/// Returns a plot and, for a reference with its tracking signal, a second plot of their difference, which is too small
/// to see in the first.
fn with_error(plot: &Plot) -> Vec<Plot> {
    let error = tracked(plot).map(|name| Plot {
        title: format!("error of {name}"),
        unit: plot.unit.clone(),
        signals: vec![format!("error.{name}")],
        ..Plot::default()
    });
    [Some(plot.clone()), error].into_iter().flatten().collect()
}

/// Returns the name shared by the two signals of a plot, a reference and its tracking signal.
fn tracked(plot: &Plot) -> Option<&str> {
    let [reference, follower] = &plot.signals[..] else {
        return None;
    };
    let name = reference.strip_prefix("reference.")?;
    (follower.split_once('.')?.1 == name).then_some(name)
}

/// Returns the PlotJuggler name of a column or a tracking error.
fn series(curve: &str) -> String {
    let root = if curve.starts_with("error.") {
        ""
    } else {
        "/record"
    };
    format!("{root}/{}", curve.replace('.', "/"))
}

fn errors(xml: &mut Xml, pages: &[Page]) -> io::Result<()> {
    let plots = pages.iter().flat_map(|page| &page.plots);
    let mut names = BTreeSet::new();
    let tracking = plots.filter_map(|plot| Some((plot, tracked(plot)?)));
    let tracking = tracking.filter(|(_, name)| names.insert(*name));
    element(xml, "customMathEquations", &[], |xml| {
        for (plot, name) in tracking {
            let name = series(&format!("error.{name}"));
            let snippet = [("name", &*name), ("language", "lua")];
            element(xml, "snippet", &snippet, |xml| {
                text_of(xml, "global", "")?;
                text_of(xml, "function", "return value - v1")?;
                text_of(xml, "linked_source", &series(&plot.signals[1]))?;
                let source = series(&plot.signals[0]);
                element(xml, "additional_sources", &[], |xml| {
                    text_of(xml, "v1", &source)
                })
            })?;
        }
        Ok(())
    })
}

fn text_of(xml: &mut Xml, name: &str, text: &str) -> io::Result<()> {
    let element = xml.create_element(name);
    element.write_text_content(BytesText::new(text)).map(drop)
}

/// Writes the data source: the recording over simulated time, loaded without a dialog. Events are left out, because
/// PlotJuggler has no JSON parser yet when it loads files from its command line.
fn data_file(xml: &mut Xml, name: &str) -> io::Result<()> {
    element(xml, "previouslyLoaded_Datafiles", &[], |xml| {
        let file = [("filename", name), ("prefix", "")];
        element(xml, "fileInfo", &file, |xml| {
            element(xml, "plugin", &[("ID", "DataLoad MCAP")], |xml| {
                let options = [
                    ("selected_topics", "/record"),
                    ("use_mcap_log_time", "1"),
                    ("use_timestamp", "0"),
                    ("clamp_large_arrays", "1"),
                    ("max_array_size", "500"),
                ];
                empty(xml, "parameters", &options)
            })
        })
    })
}
