//! Axes of a figure: their range, their ticks and the texts at the ticks.
//!
//! Ticks stand at 1, 2 and 5 times a power of ten, those of angles in degrees at parts of a turn. Never draws.

use shared_types::extremes::{larger, smaller};

use super::unit::{ScaledUnit, power_of_ten, titled};

/// Largest number of decades on an axis: what is smaller than the largest value by more is rounding.
const MOST_DECADES: f64 = 10.0;
/// Part of the range that stays free on each side of the curves.
const FREE: f64 = 0.05;
/// Ratio of a value to its ripple from which ticks show the distance from a fixed value.
const FINE: f64 = 2e4;

/// Quantity along an axis.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Quantity {
    /// Title without the unit.
    pub(super) title: String,
    pub(super) unit: String,
    /// `true` for a logarithmic axis.
    pub(super) is_log: bool,
}

/// Axis with a range.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    pub(super) title: String,
    pub(super) range: [f64; 2],
    pub(super) is_log: bool,
    pub(super) ticks: Vec<Tick>,
    /// Unit of the ticks.
    pub(super) scale: ScaledUnit,
    /// Values of ticks without text.
    pub(super) small_ticks: Vec<f64>,
}

/// Tick with its text.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tick {
    pub(super) value: f64,
    pub(super) text: String,
}

/// Range of values; empty if the first is greater than the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Extent(pub(super) [f64; 2]);

impl Extent {
    /// Contains nothing.
    pub(super) const EMPTY: Self = Self([f64::INFINITY, f64::NEG_INFINITY]);

    pub(super) fn include(&mut self, value: f64) {
        if value.is_finite() {
            self.0 = [smaller(self.0[0], value), larger(self.0[1], value)];
        }
    }

    pub(super) fn is_empty(self) -> bool {
        self.0[0] > self.0[1]
    }

    /// Lengthens the range to a least length, around its middle.
    pub(super) fn lengthen(&mut self, least: f64) {
        let [low, high] = self.0;
        let lacking = 0.5 * (least - (high - low));
        if lacking > 0.0 && !self.is_empty() {
            self.0 = [low - lacking, high + lacking];
        }
    }

    pub(super) fn length(self) -> f64 {
        self.0[1] - self.0[0]
    }
}

impl Axis {
    /// Creates an axis for values of this extent, with about `most` ticks; `is_tight` leaves no room beside them.
    pub(super) fn new(quantity: &Quantity, extent: Extent, most: f64, is_tight: bool) -> Self {
        match quantity.is_log {
            true => Self::logarithmic(quantity, extent, most, is_tight),
            false => Self::linear(quantity, extent, most, is_tight),
        }
    }

    fn linear(quantity: &Quantity, extent: Extent, most: f64, is_tight: bool) -> Self {
        let [mut low, mut high] = if extent.is_empty() {
            [-1.0, 1.0]
        } else {
            extent.0
        };
        if high - low <= 1e-12 * larger(high.abs(), low.abs()) || high == low {
            // A constant stands in the middle of its axis.
            let half = match high.abs() {
                0.0 => 1.0,
                size => 0.5 * size,
            };
            (low, high) = (low - half, high + half);
        } else if !is_tight {
            let free = FREE * (high - low);
            (low, high) = (low - free, high + free);
        }
        let step = step(quantity, (high - low) / most);
        let first = libm::ceil(low / step - 1e-9);
        let last = libm::floor(high / step + 1e-9);
        let offset = match larger(low.abs(), high.abs()) / (high - low) > FINE {
            true => libm::round(0.5 * (first + last)) * step,
            false => 0.0,
        };
        let largest = larger((low - offset).abs(), (high - offset).abs());
        let scale = ScaledUnit::of(&quantity.unit, largest);
        let decimals = -libm::floor(libm::log10(step * scale.factor()) + 1e-9);
        let decimals = if decimals > 0.0 { decimals as usize } else { 0 };
        let count = last - first;
        let values = (0..=count as u32).map(|place| (first + f64::from(place)) * step);
        let ticks = values.map(|value| Tick {
            value,
            text: number((value - offset) * scale.factor(), decimals),
        });
        let title = match offset == 0.0 {
            true => quantity.title.clone(),
            false => format!(
                "{} − {}",
                quantity.title,
                shared_types::number::exact_in(offset, &super::unit::printed(&quantity.unit))
            ),
        };
        Self {
            title: titled(title.trim(), &scale.text),
            range: [low, high],
            is_log: false,
            ticks: ticks.collect(),
            small_ticks: Vec::new(),
            scale,
        }
    }

    fn logarithmic(quantity: &Quantity, extent: Extent, most: f64, is_tight: bool) -> Self {
        let [low, high] = if extent.is_empty() || extent.0[1] <= 0.0 {
            [0.1, 1.0]
        } else {
            extent.0
        };
        let high = libm::log10(high);
        let low = larger(
            libm::log10(larger(low, f64::MIN_POSITIVE)),
            high - MOST_DECADES,
        );
        let (mut low, mut high) = match high - low < 1e-9 {
            true => (low - 0.5, high + 0.5),
            false => (low, high),
        };
        if !is_tight {
            let free = FREE * (high - low);
            (low, high) = (low - free, high + free);
        }
        let inside = |value: &f64| (low - 1e-9..=high + 1e-9).contains(&libm::log10(*value));
        let decades = libm::floor(low) as i32..=libm::ceil(high) as i32;
        let power = |decade: i32| libm::pow(10.0, f64::from(decade));
        let of = |digits: &'static [f64]| {
            let values = decades
                .clone()
                .flat_map(move |decade| digits.iter().map(move |digit| digit * power(decade)));
            values.filter(inside).collect::<Vec<f64>>()
        };
        let small = of(&[2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
        let whole = of(&[1.0]);
        let (values, small): (Vec<f64>, Vec<f64>) = if whole.len() < 2 {
            let digits = of(&[1.0, 2.0, 5.0]);
            (digits, small)
        } else {
            let every = libm::ceil(whole.len() as f64 / most) as usize;
            let is_shown = |value: &&f64| {
                let decade = libm::round(libm::log10(**value)) as i32;
                decade.rem_euclid(every as i32) == 0
            };
            let (ticks, others): (Vec<&f64>, Vec<&f64>) = whole.iter().partition(is_shown);
            let small = match every {
                1 => small,
                _ => others.into_iter().copied().collect(),
            };
            (ticks.into_iter().copied().collect(), small)
        };
        let are_plain = values.iter().all(|value| (0.001..=9999.0).contains(value));
        let tick = |value: f64| Tick {
            value,
            text: match are_plain {
                true => shared_types::number::short(value),
                false => log_text(value),
            },
        };
        let scale = ScaledUnit::of(&quantity.unit, 1.0);
        Self {
            title: titled(&quantity.title, &scale.text),
            scale,
            range: [libm::pow(10.0, low), libm::pow(10.0, high)],
            is_log: true,
            ticks: values.into_iter().map(tick).collect(),
            small_ticks: small,
        }
    }

    /// Returns the place of a value as a part of the axis; NaN for one that the axis cannot show.
    pub(super) fn part(&self, value: f64) -> f64 {
        let [low, high] = self.range;
        if self.is_log {
            let value = value.abs();
            if value == 0.0 {
                return f64::NAN;
            }
            return libm::log10(value / low) / libm::log10(high / low);
        }
        (value - low) / (high - low)
    }
}

/// Returns the distance of ticks: at least `least`.
fn step(quantity: &Quantity, least: f64) -> f64 {
    if quantity.unit == "deg" && (5.0..=360.0).contains(&least) {
        let steps = [15.0, 30.0, 45.0, 90.0, 180.0, 360.0];
        return steps
            .into_iter()
            .find(|step| *step >= least)
            .unwrap_or(360.0);
    }
    let power = libm::pow(10.0, libm::floor(libm::log10(least)));
    let steps = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power);
    steps
        .into_iter()
        .find(|step| *step >= least * (1.0 - 1e-9))
        .unwrap_or(10.0 * power)
}

/// Formats a number with a minus sign of print, and no negative zero.
pub(super) fn number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_zero = text.chars().all(|one| matches!(one, '-' | '0' | '.'));
    match text.strip_prefix('-') {
        Some(rest) if is_zero => rest.to_owned(),
        Some(rest) => format!("−{rest}"),
        None => text,
    }
}

fn log_text(value: f64) -> String {
    let decade = libm::floor(libm::log10(value) + 1e-9);
    let digit = value / libm::pow(10.0, decade);
    match libm::round(digit) {
        1.0 => power_of_ten(decade as i32),
        digit => format!("{digit}·{}", power_of_ten(decade as i32)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(unit: &str, is_log: bool, range: [f64; 2]) -> (String, Vec<String>) {
        let quantity = Quantity {
            title: "Force".into(),
            unit: unit.into(),
            is_log,
        };
        let axis = Axis::new(&quantity, Extent(range), 5.0, true);
        let texts = axis.ticks.into_iter().map(|tick| tick.text);
        (axis.title, texts.collect())
    }

    #[test]
    fn ticks_stand_at_round_numbers_and_name_their_unit_once() {
        for (unit, is_log, range, title, ticks) in [
            ("N", false, [0.0, 20.0], "Force [N]", "0 5 10 15 20"),
            ("N", false, [-1.5, 1.5], "Force [N]", "−1 0 1"),
            ("Pa", false, [0.0, 2.8e7], "Force [MPa]", "0 10 20"),
            ("N", false, [-3e-3, 2e-3], "Force [mN]", "−3 −2 −1 0 1 2"),
            ("deg", false, [-270.0, 0.0], "Force [°]", "−270 −180 −90 0"),
            ("1", true, [1e-6, 1e3], "Force", "10⁻⁶ 10⁻⁴ 10⁻² 10⁰ 10²"),
            ("Hz", true, [0.2, 40.0], "Force [Hz]", "1 10"),
            ("Hz", true, [2.0, 8.0], "Force [Hz]", "2 5"),
        ] {
            let expected = (
                title.to_owned(),
                ticks.split(' ').map(str::to_owned).collect(),
            );
            assert_eq!(axis(unit, is_log, range), expected, "{range:?}");
        }
    }

    #[test]
    fn a_ripple_on_a_large_value_is_shown_as_its_distance_from_it() {
        let (title, ticks) = axis("Pa", false, [2e7 - 2.0, 2e7 + 2.0]);
        assert_eq!(title, "Force − 2e7 Pa [Pa]");
        assert_eq!(ticks, ["−2", "−1", "0", "1", "2"]);
    }

    #[test]
    fn a_constant_has_an_axis_around_it() {
        let quantity = Quantity::default();
        let axis = Axis::new(&quantity, Extent([3.0, 3.0]), 5.0, false);
        assert_eq!(axis.range, [1.5, 4.5]);
        assert!((axis.part(3.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_logarithmic_axis_ends_ten_decades_below_its_largest_value() {
        let quantity = Quantity {
            is_log: true,
            ..Quantity::default()
        };
        let axis = Axis::new(&quantity, Extent([1e-300, 1.0]), 5.0, true);
        assert!((axis.range[0] / 1e-10 - 1.0).abs() < 1e-9);
        assert!(axis.part(0.0).is_nan());
    }
}
