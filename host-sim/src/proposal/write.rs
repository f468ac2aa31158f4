//! The case as text, with comments that mark what is guessed.
use std::fmt::Write;
use std::path::Path;

use schuler_recording::case::{Quantity, TimeUnit};

use super::column::{Guess, What};
use super::look::{Column, Look};
use super::pairs::{Pair, Pairs};

/// How far a body at rest moves its gyros, rad/s, and its accelerometers, m/s², from their middle.
const STILL: [f64; 2] = [0.02, 0.5];

/// A case that is proposed.
#[derive(Clone, Debug)]
pub struct Proposed {
    /// The text of the case file.
    pub text: String,
    /// What was found and guessed, a sentence each.
    pub said: Vec<String>,
}

/// A case of one recording: `table` is the path of its table as the case is to have it.
pub fn of_recording(look: &Look, table: &Path) -> Proposed {
    let mut text = head(look, table, &format!("Proposed from {}", file_name(&look.path)));
    let is_inertial = |column: &&Column| matches!(column.guess.what, What::Gyro(_) | What::Accelerometer(_));
    let has_inertial = look.columns.iter().any(|it| is_inertial(&it));
    text.push_str(&motion(look, has_inertial));
    let mut said = vec![super::look::said(look)];
    // Temperatures and the like are causes, unless there is nothing else to be explained.
    let is_cause = |column: &&Column| matches!(column.guess.what, What::Quantity(_));
    let all_causes = look.columns.iter().all(|it| is_cause(&it));
    let (causes, sensors): (Vec<&Column>, Vec<&Column>) =
        look.columns.iter().partition(|column| is_cause(column) && !all_causes);
    for column in &sensors {
        text.push_str(&sensor(&column.name, &column.guess, None));
    }
    for column in &causes {
        text.push_str(&auxiliary(column));
    }
    said.extend(of_columns(&sensors, &causes));
    said.extend(left_out(look));
    Proposed { text, said }
}

/// A case of a recording beside a simulation: paths as the case is to have them.
pub fn of_pair(sim: &Look, real: &Look, pairs: &Pairs<'_>, tables: [&Path; 2]) -> Proposed {
    let [sim_table, real_table] = tables;
    let title = format!("{} beside {}", file_name(&real.path), file_name(&sim.path));
    let mut text = head(real, real_table, &title);
    let (clock, covers, of_clocks) = clocks(sim, real);
    let _ = write!(
        text,
        "[simulation]\npath = {}\n{}clock = \"{clock}\"        # same: times of both are of one clock; unknown: \
         offset and rate are fitted\ncovers = \"{covers}\"         # all: a simulation that ends early is an error; part: the \
         rest is left out\n\n",
        quoted(&sim_table.display().to_string()),
        of_time(sim),
    );
    let of_motion = simulated_motion(sim);
    text.push_str(of_motion.as_deref().unwrap_or("[motion]\nkind = \"unknown\"\n\n"));
    let mut said = vec![super::look::said(sim), super::look::said(real), of_clocks];
    for pair in &pairs.pairs {
        text.push_str(&sensor(&pair.real.name, &pair.guess, Some(pair)));
        said.push(format!(
            "{} is compared with {} of the simulation{}",
            pair.real.name,
            pair.simulated.name,
            of_unit(&pair.guess, pair.simulated_unit.as_deref())
        ));
    }
    for column in &pairs.only_real {
        text.push_str(&auxiliary(column));
    }
    let names =
        |columns: &[&Column]| columns.iter().map(|it| it.name.as_str()).collect::<Vec<_>>().join(", ");
    if !pairs.only_real.is_empty() {
        said.push(format!(
            "only recorded, taken for what effects may depend on: {}; --map SIMULATED=RECORDED pairs columns of other names",
            names(&pairs.only_real)
        ));
    }
    if !pairs.only_simulated.is_empty() {
        said.push(format!("only simulated, not used: {}", names(&pairs.only_simulated)));
    }
    said.extend(left_out(real));
    said.extend(left_out(sim));
    Proposed { text, said }
}

fn head(look: &Look, table: &Path, title: &str) -> String {
    format!(
        "# Proposed by schuler: what stands behind \"guess\" was taken from names and values. Change what is wrong.\n\
         format = \"schuler-case/1\"\ntitle = {}\n\n[recording]\npath = {}\n{}{}\n\
         # [site]                 # needed where the Earth's rate or gravity enters\n# latitude_deg = 0.0\n# altitude_m = 0.0\n\n",
        quoted(title),
        quoted(&table.display().to_string()),
        of_time(look),
        if look.repeats { "duplicates = \"drop\"      # guess: rows come twice or late\n" } else { "" }
    )
}

/// The keys that say when the rows are.
fn of_time(look: &Look) -> String {
    let Some(time) = &look.time else {
        return format!(
            "step_s = {:?}            # stated: there is no time, the rows are evenly spaced\n",
            look.step_s
        );
    };
    let unit = if look.time_unit == TimeUnit::Second {
        String::new()
    } else {
        format!("time_unit = \"{}\"         # guess\n", look.time_unit)
    };
    format!("time = {}\n{unit}", quoted(time))
}

/// What the body does: at rest if its sensors do not move, else not known.
fn motion(look: &Look, has_inertial: bool) -> String {
    if !has_inertial {
        return "[motion]\nkind = \"unknown\"\n\n".to_owned();
    }
    if look.columns.iter().all(|column| is_still(&column.guess, &column.values)) {
        return "[motion]\nkind = \"static\"          # guess: no sensor moves; with attitude_deg and [site] its constants are compared\n\
                # attitude_deg = { roll = 0.0, pitch = 0.0, heading = 0.0 }\n\n"
            .to_owned();
    }
    "[motion]\nkind = \"unknown\"         # recorded, with columns of a reference; unknown checks redundant sensors alone\n\
     # rate = [\"x\", \"y\", \"z\"]                  # rad/s, inertial, body axes\n\
     # specific_force = [\"x\", \"y\", \"z\"]        # m/s^2\n\
     # attitude_rad = [\"roll\", \"pitch\", \"yaw\"]\n# velocity_ned = [\"vn\", \"ve\", \"vd\"]     # m/s\n\n"
        .to_owned()
}

fn is_still(guess: &Guess, values: &[f64]) -> bool {
    let unit = guess.unit.as_deref().and_then(|unit| {
        schuler_recording::unit::Unit::NAMES
            .iter()
            .find(|(name, _)| *name == unit)
            .map(|(_, unit)| unit.in_si())
    });
    let (Some(unit), Some(most)) = (
        unit,
        match guess.what {
            What::Gyro(_) => Some(STILL[0]),
            What::Accelerometer(_) => Some(STILL[1]),
            What::Quantity(_) | What::Other => None,
        },
    ) else {
        return true;
    };
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let at =
        |part: f64| sorted.get((part * sorted.len() as f64) as usize).copied().unwrap_or_default() * unit;
    // Spikes and the noise of a poor sensor are no motion.
    at(0.9) - at(0.1) < 2.0 * most
}

/// Rates and forces of the simulation, if it has all three axes in SI units.
fn simulated_motion(sim: &Look) -> Option<String> {
    let triple = |of: fn(usize) -> What, unit: &str| -> Option<[&str; 3]> {
        let axis = |k: usize| {
            let column = sim.columns.iter().find(|column| column.guess.what == of(k))?;
            (column.guess.unit.as_deref() == Some(unit)).then_some(column.name.as_str())
        };
        Some([axis(0)?, axis(1)?, axis(2)?])
    };
    let rate = triple(What::Gyro, "rad/s");
    let force = triple(What::Accelerometer, "m/s^2");
    if rate.is_none() && force.is_none() {
        return None;
    }
    let mut text = "[motion]\nkind = \"recorded\"        # guess: the simulation's own motion, on which effects may depend\n".to_owned();
    for (key, columns) in [("rate", rate), ("specific_force", force)] {
        if let Some(columns) = columns {
            let _ = writeln!(text, "{key} = [{}]", columns.map(quoted).join(", "));
        }
    }
    text.push('\n');
    Some(text)
}

fn sensor(name: &str, guess: &Guess, pair: Option<&Pair<'_>>) -> String {
    let (kind, axis) = match guess.what {
        What::Gyro(axis) => ("mems_gyro", Some(axis)),
        What::Accelerometer(axis) => ("accelerometer", Some(axis)),
        What::Quantity(_) | What::Other => ("other", None),
    };
    let mut text = format!("[[sensor]]\nid = {}\nkind = \"{kind}\"", quoted(name));
    text.push_str(if axis.is_some() {
        "       # guess; dtg, fog, rlg, mems_gyro, accelerometer …\n"
    } else {
        "\n"
    });
    let _ = writeln!(text, "column = {}", quoted(name));
    if let Some(pair) = pair {
        let _ = writeln!(text, "predicted = {}", quoted(&pair.simulated.name));
        if let Some(unit) = &pair.simulated_unit {
            let named = if pair.simulated.guess.unit_is_named { "" } else { "   # guess" };
            let _ = writeln!(text, "predicted_unit = {}{named}", quoted(unit));
        }
    }
    let unit = guess.unit.as_deref().unwrap_or("1");
    let mark = match (&guess.unit, guess.unit_is_named) {
        (Some(_), true) => "",
        (Some(_), false) => "   # guess",
        (None, _) => "   # not known: write the column's unit",
    };
    let _ = writeln!(text, "unit = {}{mark}", quoted(unit));
    if let Some(axis) = axis {
        let mut axes = ["0.0"; 3];
        axes[axis] = "1.0";
        let _ = writeln!(text, "axis = [{}]   # guess", axes.join(", "));
    } else if pair.is_none() {
        text.push_str("relative = true        # its level is no finding\n");
    }
    text.push_str("# [sensor.nominal]     # noise that is known, in `unit`; without it it is estimated\n# white = 0.0\n\n");
    text
}

fn auxiliary(column: &Column) -> String {
    let quantity = match column.guess.what {
        What::Quantity(quantity) => quantity,
        What::Gyro(_) | What::Accelerometer(_) | What::Other => Quantity::Other,
    };
    let unit = column.guess.unit.as_deref().unwrap_or_default();
    let mark = if column.guess.unit_is_named { "" } else { "   # guess" };
    format!(
        "[[aux]]\ncolumn = {}\nquantity = \"{quantity}\"   # guess\nunit = {}{mark}\n\n",
        quoted(&column.name),
        quoted(unit)
    )
}

/// What the simulator's clock has to do with the recording's, how much it covers, and that in a sentence.
fn clocks(sim: &Look, real: &Look) -> (&'static str, &'static str, String) {
    let ([from, to], [begin, end]) = (real.span_s, sim.span_s);
    let common = (to.min(end) - from.max(begin)).max(0.0);
    let shorter = (to - from).min(end - begin);
    if common < 0.5 * shorter {
        let said = format!(
            "clocks: the recording begins at {from:.3} s and the simulation at {begin:.3} s: offset and rate are fitted by likeness"
        );
        return ("unknown", "part", said);
    }
    let missing = (to - from) - common;
    let covers = if missing > 0.5 * real.step_s { "part" } else { "all" };
    let part = if covers == "part" {
        format!(", {missing:.3} s of the recording are not simulated and are left out")
    } else {
        String::new()
    };
    ("same", covers, format!("clocks: taken to be the same, {common:.3} s in common{part}"))
}

fn of_columns(sensors: &[&Column], causes: &[&Column]) -> Vec<String> {
    let mut said: Vec<String> = (sensors.iter())
        .map(|column| {
            let what = match column.guess.what {
                What::Gyro(_) => "a gyro",
                What::Accelerometer(_) => "an accelerometer",
                What::Quantity(_) | What::Other => "a sensor of kind other",
            };
            format!("{} is taken for {what}{}", column.name, of_unit(&column.guess, None))
        })
        .collect();
    said.extend(causes.iter().map(|column| {
        let quantity = match column.guess.what {
            What::Quantity(quantity) => quantity.to_string(),
            _ => "quantity".to_owned(),
        };
        format!(
            "{} is taken for a {quantity} on which effects may depend{}",
            column.name,
            of_unit(&column.guess, None)
        )
    }));
    said
}

fn of_unit(guess: &Guess, other: Option<&str>) -> String {
    let own = match (&guess.unit, guess.unit_is_named) {
        (Some(unit), true) => format!(", in {unit}"),
        (Some(unit), false) => format!(", in {unit} (a guess)"),
        (None, _) => ", in a unit that is not known".to_owned(),
    };
    match other {
        Some(other) => format!("{own}, the simulation in {other}"),
        None => own,
    }
}

fn left_out(look: &Look) -> Option<String> {
    (!look.left_out.is_empty())
        .then(|| format!("left out of {}: {}", look.path.display(), look.left_out.join(", ")))
}

fn file_name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// A basic string of TOML, whose escapes those of JSON are.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string().replace('\u{7f}', "\\u007f")
}

#[cfg(test)]
mod tests {
    use schuler_recording::CaseFile;
    use schuler_recording::case::{MotionKind, SensorKind};

    use super::super::pairs::pairs;
    use super::super::{Times, look_at};
    use super::*;

    fn table(folder: &Path, name: &str, text: &str) -> Look {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        look_at(&path, Times::Guessed).unwrap()
    }

    fn parsed(proposed: &Proposed) -> CaseFile {
        let file = CaseFile::parse(Path::new("c.toml"), &proposed.text);
        file.unwrap_or_else(|error| panic!("{error:#}\n{}", proposed.text))
    }

    #[test]
    fn a_recording_becomes_a_case_that_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let text = "time_ms,gyro_x [deg/s],acc_z,temp,flow \"l/min\",note,mode\n0,0.1,9.8,20,1,a,4\n10,0.2,9.9,21,2,b,4\n20,0.1,9.8,22,4,c,4\n";
        let look = table(folder.path(), "r.csv", text);
        let proposed = of_recording(&look, Path::new("r.csv"));
        let case = parsed(&proposed).case;
        assert_eq!(
            (case.recording.time.as_deref(), case.recording.time_unit),
            (Some("time_ms"), Some(TimeUnit::Millisecond))
        );
        assert_eq!(case.motion.kind, MotionKind::Static);
        let kinds: Vec<SensorKind> = case.sensors.iter().map(|sensor| sensor.kind).collect();
        assert_eq!(kinds, [SensorKind::MemsGyro, SensorKind::Accelerometer, SensorKind::Other]);
        assert_eq!(case.sensors[1].axis, Some([0.0, 0.0, 1.0]));
        assert_eq!(case.auxiliaries[0].quantity, Quantity::Temperature);
        let said = proposed.said.join("\n");
        assert!(said.contains("note (no numbers)") && said.contains("mode (constant)"), "{said}");
        assert!(proposed.text.contains("unit = \"m/s^2\"   # guess"), "{}", proposed.text);
    }

    #[test]
    fn a_pair_becomes_a_case_with_its_simulation() {
        let folder = tempfile::tempdir().unwrap();
        let real = table(folder.path(), "r.csv", "t,wx,wy,wz,T\n0,30,1,2,5\n1,31,2,1,6\n2,30,1,3,7\n");
        let sim = table(folder.path(), "s.csv", "t,wx,wy,wz\n0,0.5,0.1,0.2\n1,0.4,0.2,0.1\n");
        let pairs = pairs(&sim, &real, &[]).unwrap();
        let proposed = of_pair(&sim, &real, &pairs, [Path::new("s.csv"), Path::new("r.csv")]);
        let case = parsed(&proposed).case;
        assert_eq!(case.sensors[0].predicted.as_deref(), Some("wx"));
        assert_eq!(case.sensors[0].predicted_unit.map(schuler_recording::unit::Unit::name), Some("rad/s"));
        assert_eq!(case.motion.rate, Some(["wx", "wy", "wz"].map(str::to_owned)));
        let said = proposed.said.join("\n");
        assert!(said.contains("1.000 s of the recording are not simulated"), "{said}");
        assert_eq!(case.auxiliaries[0].column, "T");
    }

    #[test]
    fn names_with_quotes_stay_what_they_are() {
        assert_eq!(quoted("a\"b\\c\n\u{7f}"), "\"a\\\"b\\\\c\\n\\u007f\"");
    }
}
