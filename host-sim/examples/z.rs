//! x
fn main() {
    for a in std::env::args().skip(1) {
        let t = std::time::Instant::now();
        let r = schuler_recording::Recording::read(a.as_ref()).unwrap();
        let i = host_sim::identify::identify(&r, Default::default(), |_| ());
        print!("{i}");
        println!("   {:?}", t.elapsed());
        if std::env::var("V").is_ok() {
            for s in &i.sensors {
                println!(
                    "== {} p {:?} white p {:?} nominal\n{}",
                    s.id, s.power_laws_p, s.structure.whiteness_p, s.structure.nominal
                );
                for m in &s.structure.models {
                    println!("  {:<40} gain {:.2} schwarz {:.2}", m.name, m.gain_nats, m.schwarz);
                }
                if let Some(p) = &s.structure.published {
                    println!(
                        "  published D={} {:?} {:?}",
                        p.averaged_steps,
                        p.markov.map(|m| (m.sigma.value, m.tau_s.value, m.tau_s.standard_deviation)),
                        p.exp_cos
                    );
                }
                for a in &s.allan {
                    if a.point.factor.is_power_of_two() {
                        println!(
                            "    tau {:7.1} {:.4e} [{:.3e} {:.3e}] alpha {} edf {:.1} laws {:?} struct {:?}",
                            a.point.tau_s,
                            a.point.deviation,
                            a.point.lower,
                            a.point.upper,
                            a.point.exponent,
                            a.point.degrees_of_freedom,
                            a.power_laws,
                            a.structure
                        );
                    }
                }
            }
        }
    }
}
