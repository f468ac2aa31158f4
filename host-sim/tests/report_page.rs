//! The page of an explanation: in a real browser, and against hostile names.
mod browser;
mod report_sample;

use std::path::Path;

use browser::Browser;
use host_sim::plot::Format;
use serde_json::{Value, json};

/// Largest page of a day of six sensors, bytes.
const LARGEST: usize = 3_000_000;

fn written(directory: &Path, name: &str, page: &str) -> std::path::PathBuf {
    let path = directory.join("report.html");
    std::fs::write(&path, page).unwrap();
    if let Some(directory) = std::env::var_os("SCHULER_SCREENSHOTS") {
        std::fs::write(Path::new(&directory).join(format!("{name}.html")), page).unwrap();
    }
    path
}

/// A picture of the whole page, where SCHULER_SCREENSHOTS says; for looking at.
fn picture(browser: &mut Browser, name: &str) {
    let Some(directory) = std::env::var_os("SCHULER_SCREENSHOTS") else { return };
    let shot =
        browser.call("Page.captureScreenshot", &json!({ "captureBeyondViewport": true, "format": "png" }));
    save(Path::new(&directory).join(format!("{name}.png")).as_path(), &shot["data"]);
}

fn save(path: &Path, base64: &Value) {
    std::fs::write(path, decoded(base64.as_str().unwrap())).unwrap();
}

/// Base64 as the protocol writes it.
fn decoded(text: &str) -> Vec<u8> {
    let digit = |c: u8| match c {
        b'A'..=b'Z' => c - b'A',
        b'a'..=b'z' => c - b'a' + 26,
        b'0'..=b'9' => c - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let digits: Vec<u8> = text.bytes().filter(|c| *c != b'=').map(digit).collect();
    let bits =
        |four: &[u8]| four.iter().fold(0u32, |bits, d| bits << 6 | u32::from(*d)) << (6 * (4 - four.len()));
    let bytes = |four: &[u8]| bits(four).to_be_bytes()[1..four.len()].to_vec();
    digits.chunks(4).flat_map(bytes).collect()
}

/// Widest overhang beyond the window, pixels.
fn overhang(browser: &mut Browser) -> f64 {
    browser.value("document.documentElement.scrollWidth - innerWidth").as_f64().unwrap()
}

/// Where a plot stands in the window after scrolling to it: left, top, width, height of its inner area.
fn inner_area(browser: &mut Browser, plot: usize) -> [f64; 4] {
    let script = format!(
        "(() => {{ const it = document.querySelectorAll('.plot .u-over')[{plot}]; \
         it.scrollIntoView({{ block: 'center' }}); const box = it.getBoundingClientRect(); \
         return [box.left, box.top, box.width, box.height]; }})()"
    );
    let found = browser.value(&script);
    [0, 1, 2, 3].map(|k| found[k].as_f64().unwrap())
}

/// What the read-outs of a plot show.
fn read_outs(browser: &mut Browser, plot: usize) -> Vec<String> {
    let script = format!(
        "[...document.querySelectorAll('.plot')[{plot}].querySelectorAll('.u-legend .u-series')]\
         .filter(it => it.style.display !== 'none').map(it => it.textContent)"
    );
    let found = browser.value(&script);
    found.as_array().unwrap().iter().map(|it| it.as_str().unwrap().to_owned()).collect()
}

/// Checksum of what a plot has drawn.
fn drawn(browser: &mut Browser, plot: usize) -> String {
    let script = format!("document.querySelectorAll('.plot canvas')[{plot}].toDataURL()");
    browser.value(&script).as_str().unwrap().to_owned()
}

/// The first screen holds the paragraph, the picture and the table.
fn assert_first_screen(browser: &mut Browser, height: f64) {
    for (what, selector) in [("paragraph", ".verdict"), ("picture", ".lead .plot"), ("table", ".lead table")]
    {
        let bottom = format!("document.querySelector('{selector}').getBoundingClientRect().bottom");
        let bottom = browser.value(&bottom).as_f64().unwrap();
        assert!(bottom <= height, "{what}: {bottom}");
    }
}

#[test]
fn a_day_of_six_sensors_works_in_a_real_browser() {
    let Some(mut browser) = Browser::start() else { return };
    let directory = tempfile::tempdir().unwrap();
    let page = report_sample::report("").html();
    assert!(page.len() < LARGEST, "{} bytes", page.len());
    let path = written(directory.path(), "day", &page);
    browser.call(
        "Emulation.setEmulatedMedia",
        &json!({ "features": [{ "name": "prefers-color-scheme", "value": "light" }] }),
    );
    browser.resize(1280, 900, false);
    browser.open(&path);

    // Every chart is drawn, and every one has a description.
    let plots = browser.value("document.querySelectorAll('.plot').length").as_u64().unwrap() as usize;
    // One of them on the first screen as well as with its sensor.
    assert_eq!(plots, 6 * 5 + 2 + 1);
    let canvases = browser.value("document.querySelectorAll('.plot canvas').length").as_u64().unwrap();
    assert_eq!(canvases as usize, plots);
    assert_eq!(
        browser.value("[...document.querySelectorAll('.plot')].every(it => it.ariaLabel.length > 40)"),
        true
    );
    assert_eq!(browser.value("document.querySelectorAll('figcaption').length"), plots);
    picture(&mut browser, "light");

    assert_first_screen(&mut browser, 900.0);

    // Before and after.
    let both = read_outs(&mut browser, 0);
    assert_eq!(both.len(), 4, "{both:?}");
    let picture_of_both = drawn(&mut browser, 0);
    browser.value("document.querySelector('input[value=after]').click()");
    let after = read_outs(&mut browser, 0);
    assert!(after.len() == 2 && after[1].starts_with("remainder"), "{after:?}");
    assert_ne!(drawn(&mut browser, 0), picture_of_both);
    picture(&mut browser, "after");
    browser.value("document.querySelector('input[value=before]').click()");
    assert!(read_outs(&mut browser, 0)[1].starts_with("recorded − simulated"));
    browser.value("document.querySelector('input[value=both]').click()");

    // The cursor reads.
    let [left, top, width, height] = inner_area(&mut browser, 0);
    browser.mouse("mouseMoved", left + width / 2.0, top + height / 2.0);
    browser.resize(1280, 900, false);
    let read = read_outs(&mut browser, 0);
    let hour: f64 = read[0].strip_prefix("time, h").unwrap().parse().unwrap();
    assert!((hour - 12.0).abs() < 0.2, "{read:?}");

    // A drag zooms, and the plots of the same sensor over time go along; a double click shows all again.
    let innovations = browser
        .value("[...document.querySelectorAll('.plot')].findIndex(it => it.ariaLabel.startsWith('Innovations over time'))")
        .as_u64()
        .unwrap() as usize;
    let other = drawn(&mut browser, innovations);
    let whole = drawn(&mut browser, 0);
    let [left, top, width, height] = inner_area(&mut browser, 0);
    let middle = top + height / 2.0;
    browser.mouse("mousePressed", left + 0.3 * width, middle);
    browser.mouse("mouseMoved", left + 0.35 * width, middle);
    browser.mouse("mouseMoved", left + 0.4 * width, middle);
    browser.mouse("mouseReleased", left + 0.4 * width, middle);
    browser.resize(1280, 900, false);
    assert_ne!(drawn(&mut browser, 0), whole);
    assert_ne!(drawn(&mut browser, innovations), other);
    browser.value("document.querySelector('figure button[data-act=all]').click()");
    browser.resize(1280, 900, false);
    assert_eq!(drawn(&mut browser, innovations), other);

    // The same with the keyboard, which also says what it reads.
    browser.value("document.querySelectorAll('.plot')[0].focus()");
    browser.press("ArrowRight");
    let told = browser.value("document.querySelectorAll('.plot')[0].querySelector('.told').textContent");
    assert!(told.as_str().unwrap().contains("recorded − simulated"), "{told}");
    browser.press("+");
    browser.resize(1280, 900, false);
    assert_ne!(drawn(&mut browser, 0), whole);
    browser.press("0");

    // Dark by the button, and by the system.
    let background = "getComputedStyle(document.body).backgroundColor";
    assert_eq!(browser.value(background), "rgb(255, 255, 255)");
    browser.value("document.getElementById('theme').click()");
    assert_eq!(browser.value(background), "rgb(20, 23, 27)");
    picture(&mut browser, "dark");
    browser.value("document.getElementById('theme').click()");
    assert_eq!(browser.value(background), "rgb(255, 255, 255)");

    // A telephone.
    browser.resize(360, 780, true);
    browser.resize(360, 780, true);
    assert!(overhang(&mut browser) <= 0.0, "{} pixels", overhang(&mut browser));
    browser.value("document.querySelector('details.sensor').open = true");
    browser.resize(360, 780, true);
    let widest = browser.value(
        "Math.max(...[...document.querySelectorAll('.plot canvas')].filter(it => it.checkVisibility()).map(it => it.getBoundingClientRect().right))",
    );
    assert!(widest.as_f64().unwrap() <= 360.0, "{widest}");
    picture(&mut browser, "phone");

    // Paper: a few pages, and light although the screen is dark.
    browser.resize(1280, 900, false);
    browser.value("document.querySelector('details.sensor').open = false");
    browser.value("document.getElementById('theme').click()");
    let pdf = decoded(
        browser.call("Page.printToPDF", &json!({ "printBackground": true }))["data"].as_str().unwrap(),
    );
    assert!(pdf.starts_with(b"%PDF"));
    let pages = String::from_utf8_lossy(&pdf).matches("/Type /Page\n").count();
    assert!((2..=4).contains(&pages), "{pages} pages");
    if let Some(directory) = std::env::var_os("SCHULER_SCREENSHOTS") {
        std::fs::write(Path::new(&directory).join("print.pdf"), &pdf).unwrap();
    }
    assert_eq!(browser.value(background), "rgb(20, 23, 27)");

    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
    let elsewhere: Vec<&String> =
        browser.requested.iter().filter(|url| !url.starts_with("file://")).collect();
    assert!(elsewhere.is_empty() && browser.requested.len() == 1, "{:?}", browser.requested);
}

#[test]
fn the_page_follows_a_dark_system_and_contrast_is_enough() {
    let Some(mut browser) = Browser::start() else { return };
    let directory = tempfile::tempdir().unwrap();
    let path = written(directory.path(), "nothing", &report_sample::nothing_found().html());
    browser.resize(1000, 800, false);
    // Relative luminance and contrast by WCAG 2.2.
    let least_contrast = "(() => { \
        const luminance = (text) => { const [r, g, b] = text.match(/[\\d.]+/g).map(Number).map(v => v / 255) \
            .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4); \
            return 0.2126 * r + 0.7152 * g + 0.0722 * b; }; \
        const back = (it) => { for (; it; it = it.parentElement) { const c = getComputedStyle(it).backgroundColor; \
            if (!/, 0\\)$/.test(c)) return c; } return 'rgb(255, 255, 255)'; }; \
        let least = 99; \
        for (const it of document.querySelectorAll('h1,h2,h3,h4,p,li,dt,dd,th,td,figcaption,button,span,code,a,strong')) { \
            if (!it.textContent.trim() || it.closest('.u-marker')) continue; \
            const a = luminance(getComputedStyle(it).color), b = luminance(back(it)); \
            least = Math.min(least, (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05)); } \
        return least; })()";
    for scheme in ["light", "dark"] {
        let media = json!({ "features": [{ "name": "prefers-color-scheme", "value": scheme }] });
        browser.call("Emulation.setEmulatedMedia", &media);
        browser.open(&path);
        let contrast = browser.value(least_contrast).as_f64().unwrap();
        assert!(contrast >= 4.5, "{scheme}: {contrast}");
        picture(&mut browser, &format!("nothing_{scheme}"));
    }
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

#[test]
fn hostile_names_stay_text() {
    let hostile = "</script><img src=x onerror=document.title='owned'>&\"'<b>";
    let page = report_sample::report(hostile).html();
    assert!(!page.contains("<img") && !page.contains("<b>"));
    // The page's own scripts are the only ones, and its data are whole.
    assert_eq!(page.matches("<script").count(), 3);
    assert_eq!(page.matches("</script").count(), 3);
    let Some(mut browser) = Browser::start() else { return };
    let directory = tempfile::tempdir().unwrap();
    browser.open(&written(directory.path(), "hostile", &page));
    let title = browser.value("document.title");
    assert!(title.as_str().unwrap().contains("onerror"), "{title}");
    assert_eq!(browser.value("document.querySelectorAll('img, b').length"), 0);
    browser.resize(360, 780, true);
    assert!(overhang(&mut browser) <= 0.0);
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

#[test]
fn the_page_asks_for_nothing() {
    let page = report_sample::report("").html();
    for word in [" src=", "<link", "@import", "url("] {
        assert!(!page.contains(word), "{word}");
    }
    assert!(page.contains("default-src 'none'"));
}

#[test]
fn the_text_says_what_how_much_and_how_sure() {
    let text = report_sample::report("").text();
    for said in [
        "gyro_x drifts with the rate of its temperature: 0.501 ± 0.012 °/h per K/h.",
        "From 8 h 20 min on, gyro_y jumps by a constant: coefficient 1.62 ± 0.09 °/h, onset 30010 ± 40 s.",
        "It may be bias_thermal_lag of gyro_x: probability 0.33.",
        "A daily cycle, or two steps",
        "Not plausible for such a sensor: coefficient 1.62 ± 0.09 °/h.",
        "falls from 1.39 to 1.00",
        "Left over in gyro_z",
        "(probability above 0.9999). It explains 61 % of the mismatch, with the other finding 81 %.",
        "Left uncorrected, the errors of gyro_x put a navigation solution 1.2 km and 40″ off after 1 h.",
        "gyro_x: white 0.200 °/h, Markov 0.0500 °/h over 5 min (stated white 0.200 °/h); its spectrum holds to within 9 %",
        "gyro_x: at most 0.0060 °/h (root mean square), by bias_warmup of 0.022 °/h",
    ] {
        let flat = text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(flat.contains(said), "{said}\n{text}");
    }
    let nothing = report_sample::nothing_found().text();
    assert!(nothing.contains("Nothing was found: the recording agrees with its simulation."), "{nothing}");
}

#[test]
fn figures_are_drawn_for_every_sensor_and_finding() {
    let figures = report_sample::report("").figures();
    assert_eq!(figures.len(), 6 * 2 + 2);
    for (name, figure) in &figures {
        assert!(figure.to_svg().is_ok(), "{name}");
    }
    // Whatever a sensor is called, its figure stays in the directory.
    let directory = tempfile::tempdir().unwrap();
    let inside = directory.path().join("figures");
    std::fs::create_dir(&inside).unwrap();
    for (name, figure) in report_sample::report("../").figures() {
        for path in figure.write(&inside, &name, &[Format::Svg]).unwrap() {
            assert_eq!(
                path.canonicalize().unwrap().parent(),
                Some(&*inside.canonicalize().unwrap()),
                "{name}"
            );
        }
    }
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1);
}
