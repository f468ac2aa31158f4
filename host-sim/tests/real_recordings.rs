//! Real recordings through the flight module. They are not part of the project: they are looked for in `../shared/data`
//! beside it, or where SCHULER_DATA says.
use std::path::{Path, PathBuf};

use host_sim::flight::{self, Flown, On, Summary};
use schuler_recording::Recording;

/// The folder of a real recording; none, and loud about it, where it is not there.
fn folder(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("SCHULER_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let path = root.join(name);
    if path.is_dir() {
        return Some(path);
    }
    eprintln!("SKIPPED: no real recordings at {} (set SCHULER_DATA)", path.display());
    None
}

#[test]
fn the_six_legs_of_the_underwater_vehicle_fly_north_and_east() {
    let Some(folder) = folder("auv_doppler_ins") else { return };
    println!("leg channel  used gated upsets  NIS    whiteness p  rms of successive differences");
    for leg in 1..=6 {
        let recording = Recording::read(&folder.join(format!("leg0{leg}.toml"))).unwrap();
        let channels = flight::plan(&recording).unwrap();
        assert_eq!(channels.len(), 2);
        for channel in channels {
            let flown = Flown::of(channel, &recording, On::Host, |_| Ok(())).unwrap();
            let (channel, steps) = (&flown.channel, &flown.steps);
            assert_eq!(steps.len(), 400);
            assert!((channel.config.filter.step_s - 1.0025).abs() < 1e-6);
            assert!((channel.config.filter.velocity_noise - 0.02).abs() < 1e-6);
            let differences: Vec<f64> = steps
                .windows(2)
                .map(|w| f64::from(w[1].input.velocity_error.value - w[0].input.velocity_error.value))
                .collect();
            let name = &channel.name;
            let summary = Summary::of(&flown, None);
            let filter = summary.filter.unwrap();
            // Every step is accounted for, and nothing is lost of a recording without gaps.
            assert_eq!(filter.used + filter.gated + filter.missing + filter.refused, 400, "leg {leg} {name}");
            assert_eq!(filter.missing, 0);
            assert!(filter.used > 200, "leg {leg} {name}: {} used", filter.used);
            assert!(filter.end.iter().all(|state| state.estimate.is_finite() && state.sigma > 0.0));
            // The velocity error of either system stays far below the vehicle's 2 m/s: frames and signs are right.
            let steps = (differences.iter().map(|d| d * d).sum::<f64>() / 399.0).sqrt();
            assert!(flown.outputs.iter().all(|o| o.filter.estimate[0].abs() < 1.5), "leg {leg} {name}");
            println!(
                "{leg}   {name:<7} {:>5} {:>5} {:>5}  {:>6.3}  {:>9.2e}  {:.3} m/s",
                filter.used, filter.gated, filter.upsets, filter.nis.mean, filter.whiteness.p_value, steps
            );
        }
    }
}
