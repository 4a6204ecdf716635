//! Report pages in a real browser: Chromium without a window, with WebGL in software.
//!
//! A test puts a program of its own before and after that of the page, names both in the page's content security policy, and
//! reads what they leave in the document.

mod stories;

use std::fmt::Write as _;
use std::fs::File;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use isochor::{Axis, Outcome};
use isochor_view::{Figure, Page, Show, ShownPose, page};
use scraper::{Html, Selector};
use serde_json::Value;
use sha2::{Digest, Sha256};
use stories::Story;

/// Before anything else in the page: notes what goes wrong, and draws when it is told to. So a test is over before the page has
/// loaded, however slow the machine is.
const FIRST: &str = "
let waiting = [];
requestAnimationFrame = (draw) => waiting.push(draw);
const frame = () => {
  const now = waiting;
  waiting = [];
  now.forEach((draw) => draw(performance.now()));
};
const noted = { errors: [], violations: [] };
addEventListener('error', (event) => noted.errors.push(String(event.message)));
addEventListener('unhandledrejection', (event) => noted.errors.push(String(event.reason)));
addEventListener('securitypolicyviolation', (event) => noted.violations.push(event.violatedDirective));
for (const kind of ['error', 'warn']) {
  console[kind] = (...what) => noted.errors.push(what.join(' '));
}
";

/// What the tests' programs are written in.
const WORDS: &str = "
const canvas = document.querySelector('canvas');
const figure = document.querySelector('[data-viewer]');
// No hand moves these pointers, so there is nothing to capture.
canvas.setPointerCapture = canvas.releasePointerCapture = () => {};
canvas.hasPointerCapture = () => false;
// The picture as it is: how much of it is drawn upon, and all of it as one text.
const seen = () => {
  frame();
  const copy = document.createElement('canvas');
  [copy.width, copy.height] = [canvas.width, canvas.height];
  const context = copy.getContext('2d', { willReadFrequently: true });
  context.drawImage(canvas, 0, 0);
  const { data } = context.getImageData(0, 0, copy.width, copy.height);
  const sums = [0, 0, 0, 0];
  let hash = 17;
  let [left, right, top, bottom] = [Infinity, -Infinity, Infinity, -Infinity];
  for (let i = 0; i < data.length; i += 4) {
    for (let k = 0; k < 4; k++) {
      sums[k] += data[i + k];
      hash = (Math.imul(hash, 31) + data[i + k]) | 0;
    }
    if (data[i + 3] > 0) {
      const [x, y] = [(i / 4) % copy.width, Math.floor(i / 4 / copy.width)];
      [left, right] = [Math.min(left, x), Math.max(right, x)];
      [top, bottom] = [Math.min(top, y), Math.max(bottom, y)];
    }
  }
  const drawn = sums[3] / 255 / (copy.width * copy.height);
  return { drawn, red: sums[0], blue: sums[2], width: right - left, height: bottom - top, hash };
};
const press = (selector) => document.querySelector(selector).click();
const key = (key) => canvas.dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true, cancelable: true }));
const pointer = (type, id, x, y, pointerType, buttons) => {
  const { left, top } = canvas.getBoundingClientRect();
  canvas.dispatchEvent(new PointerEvent(type, {
    pointerId: id, clientX: left + x, clientY: top + y, pageX: left + x, pageY: top + y,
    button: buttons === 2 ? 2 : 0, buttons, pointerType, isPrimary: id === 1, bubbles: true, cancelable: true,
  }));
};
const drag = (buttons) => {
  pointer('pointerdown', 1, 200, 150, 'mouse', buttons);
  pointer('pointermove', 1, 260, 170, 'mouse', buttons);
  pointer('pointerup', 1, 260, 170, 'mouse', 0);
};
const wheel = () => {
  const event = new WheelEvent('wheel', { deltaY: -200, bubbles: true, cancelable: true });
  canvas.dispatchEvent(event);
  return event.defaultPrevented;
};
";

/// The build script's find.
const BROWSER: Option<&str> = option_env!("ISOCHOR_CHROMIUM_FILE");

/// A browser that takes longer than this hangs. A second or two are usual; the machine may be busy.
const PATIENCE: Duration = Duration::from_secs(180);

/// What the document at `file` is in the end, and what the browser's console says.
fn opened(file: &Path, folder: &Path, extra: &[&str]) -> (String, String) {
    let browser = BROWSER.expect("tests without a browser are ignored");
    let (out, err) = (folder.join("document.html"), folder.join("log.txt"));
    let mut child = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
        .args(["--no-first-run", "--disable-quic", "--disable-background-networking", "--disable-component-update"])
        .args(["--disable-sync", "--disable-dev-shm-usage", "--window-size=1000,900", "--enable-logging=stderr"])
        .args(extra)
        .args(["--virtual-time-budget=20000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", folder.join("profile").display()))
        .arg(format!("file://{}", file.display()))
        .stdin(Stdio::null())
        .stdout(File::create(&out).unwrap())
        .stderr(File::create(&err).unwrap())
        .spawn()
        .unwrap();
    let start = Instant::now();
    let status = loop {
        match child.try_wait().unwrap() {
            Some(status) => break status,
            None if start.elapsed() > PATIENCE => {
                child.kill().unwrap();
                child.wait().unwrap();
                panic!("the browser does not end: {}", String::from_utf8_lossy(&std::fs::read(&err).unwrap()));
            }
            None => std::thread::sleep(Duration::from_millis(50)),
        }
    };
    let read = |file: &Path| String::from_utf8_lossy(&std::fs::read(file).unwrap()).into_owned();
    assert!(status.success(), "{status}: {}", read(&err));
    // Reading pixels is slow, says the driver; only tests do it.
    let is_said = |line: &&str| line.contains(":CONSOLE:") && !line.contains("GL Driver Message");
    (read(&out), read(&err).lines().filter(is_said).collect())
}

/// What `program` returns in the page, with `noted`; and the browser's words.
fn told(page: &str, program: &str, extra: &[&str]) -> (Value, String) {
    let folder = tempfile::tempdir().unwrap();
    let last = format!(
        "{WORDS}
        (async () => {program})().catch((error) => ({{ failed: String(error) }})).then((result) => {{
          const requests = performance.getEntriesByType('resource').map((entry) => entry.name);
          const element = document.createElement('pre');
          element.id = 'told';
          element.textContent = JSON.stringify({{ result, requests, ...noted }});
          document.body.append(element);
        }});"
    );
    let named = |script: &str| format!("'sha256-{}' ", STANDARD.encode(Sha256::digest(script)));
    let page = page.replacen("script-src ", &format!("script-src {}{}", named(FIRST), named(&last)), 1).replacen(
        "<meta name=\"viewport\"",
        &format!("<script>{FIRST}</script><meta name=\"viewport\""),
        1,
    );
    let (before, after) = page.rsplit_once("</body>").unwrap();
    let file = folder.path().join("page.html");
    std::fs::write(&file, format!("{before}<script>{last}</script></body>{after}")).unwrap();
    let (document, log) = opened(&file, folder.path(), extra);
    let text = text_told(&document);
    let told = serde_json::from_str(&text).unwrap_or_else(|error| panic!("the program did not end, {error}: {log}"));
    (told, log)
}

fn text_told(document: &str) -> String {
    let told = Selector::parse("#told").unwrap();
    Html::parse_document(document).select(&told).flat_map(|element| element.text()).collect()
}

/// The same, of a page on which nothing may go wrong.
fn told_well(page: &str, program: &str) -> Value {
    let (told, log) = told(page, program, &[]);
    assert!(told["result"]["failed"].is_null(), "{}", told["result"]["failed"]);
    for none in ["errors", "violations", "requests"] {
        assert_eq!(told[none], serde_json::json!([]), "{none}");
    }
    assert_eq!(log, "");
    told["result"].clone()
}

fn twisted_page() -> String {
    let run = Story::twisted_cube().run();
    let show = run.show();
    let contents = Page {
        title: "cube".into(),
        job: Some(Story::twisted_cube().job.into()),
        report: &run.outcome.report,
        pictures: vec![Figure { caption: "one pixel".into(), png: STANDARD.decode(PIXEL).unwrap() }],
        show: Some(&show),
        up: Axis::Z,
    };
    page(&contents)
}

/// A PNG of one pixel.
const PIXEL: &str = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg==";

fn hash<'a>(seen: &'a Value, name: &str) -> &'a Value {
    let hash = &seen[name]["hash"];
    assert!(hash.is_i64(), "{name}: {seen}");
    hash
}

#[cfg_attr(not(isochor_chromium), ignore = "needs Chromium: set ISOCHOR_CHROMIUM")]
#[test]
fn the_model_is_seen_and_buttons_change_it() {
    let seen = told_well(
        &twisted_page(),
        "{
          const out = { state: figure.dataset.state, disabled: document.querySelectorAll('button:disabled').length };
          out.start = seen();
          out.again = seen();
          out.says = [];
          out.legend = [];
          for (const pose of [0, 1, 2]) {
            press(`[data-pose='${pose}']`);
            out['pose' + pose] = seen();
            out.says.push(document.querySelector('output').textContent);
            out.legend.push(document.querySelector('[data-legend]').hidden);
          }
          for (const name of ['lattice', 'colour', 'wireframe', 'smooth']) {
            press(`[data-toggle='${name}']`);
            out[name] = seen();
            out[name].pressed = document.querySelector(`[data-toggle='${name}']`).getAttribute('aria-pressed');
            press(`[data-toggle='${name}']`);
          }
          out.end = seen();
          return out;
        }",
    );
    assert_eq!((&seen["state"], &seen["disabled"]), (&"ready".into(), &0.into()));
    let drawn = seen["start"]["drawn"].as_f64().unwrap();
    assert!((0.05..0.7).contains(&drawn), "the model fills {drawn} of the picture");
    let start = hash(&seen, "start");
    for same in ["again", "pose2", "end"] {
        assert_eq!(hash(&seen, same), start, "{same}");
    }
    for other in ["pose0", "pose1", "lattice", "colour", "wireframe", "smooth"] {
        assert_ne!(hash(&seen, other), start, "{other}");
    }
    assert_ne!(hash(&seen, "pose0"), hash(&seen, "pose1"));
    let pressed = ["lattice", "colour", "wireframe", "smooth"].map(|name| seen[name]["pressed"].as_str().unwrap());
    assert_eq!(pressed, ["false", "false", "true", "false"]);
    // At rest nothing has changed its volume.
    assert_eq!(seen["legend"], serde_json::json!([true, false, false]));
    let says: Vec<_> = seen["says"].as_array().unwrap().iter().map(|says| says.as_str().unwrap()).collect();
    assert_eq!(says[0], "rest: volume 1 (±0\u{202f}%)");
    assert!(says[1].starts_with("deformed: volume 0."), "{}", says[1]);
    assert_eq!(says[2], "corrected: volume 1 (±0\u{202f}%)");
}

#[cfg_attr(not(isochor_chromium), ignore = "needs Chromium: set ISOCHOR_CHROMIUM")]
#[test]
fn the_model_is_turned_moved_and_zoomed_by_hand() {
    let seen = told_well(
        &twisted_page(),
        "{
          const out = { start: seen(), asleep: wheel(), unmoved: seen() };
          const home = () => press('[data-home]');
          drag(1);
          out.turned = seen();
          home();
          out.home = seen();
          drag(2);
          out.moved = seen();
          home();
          out.awake = wheel();
          out.zoomed = seen();
          home();
          pointer('pointerdown', 1, 200, 200, 'touch', 1);
          pointer('pointermove', 1, 230, 200, 'touch', 1);
          pointer('pointerup', 1, 230, 200, 'touch', 0);
          out.touched = seen();
          home();
          pointer('pointerdown', 1, 200, 200, 'touch', 1);
          pointer('pointerdown', 2, 260, 200, 'touch', 1);
          pointer('pointermove', 2, 300, 200, 'touch', 1);
          pointer('pointermove', 1, 160, 200, 'touch', 1);
          pointer('pointerup', 1, 160, 200, 'touch', 0);
          pointer('pointerup', 2, 300, 200, 'touch', 0);
          out.pinched = seen();
          home();
          out.end = seen();
          return out;
        }",
    );
    let start = hash(&seen, "start");
    for same in ["unmoved", "home", "end"] {
        assert_eq!(hash(&seen, same), start, "{same}");
    }
    for other in ["turned", "moved", "zoomed", "touched", "pinched"] {
        assert_ne!(hash(&seen, other), start, "{other}");
    }
    // The wheel belongs to the page until the view was clicked.
    assert_eq!((&seen["asleep"], &seen["awake"]), (&false.into(), &true.into()));
    for nearer in ["zoomed", "pinched"] {
        assert!(seen[nearer]["drawn"].as_f64() > seen["start"]["drawn"].as_f64(), "{nearer}");
    }
}

#[cfg_attr(not(isochor_chromium), ignore = "needs Chromium: set ISOCHOR_CHROMIUM")]
#[test]
fn keys_do_what_buttons_and_hands_do() {
    let seen = told_well(
        &twisted_page(),
        "{
          const out = { start: seen() };
          canvas.focus();
          out.focused = document.activeElement === canvas;
          const both = async (name, selector, ...keys) => {
            press(selector);
            const pressed = (seen()).hash;
            key(keys[1] ?? keys[0]);
            key(keys[0]);
            out[name] = { hash: (seen()).hash, pressed };
          };
          for (const digit of [1, 2, 3]) {
            press(`[data-pose='${digit - 1}']`);
            const pressed = (seen()).hash;
            key(digit === 3 ? '1' : '3');
            key(String(digit));
            out[digit] = { hash: (seen()).hash, pressed };
          }
          for (const name of ['lattice', 'colour', 'wireframe', 'smooth']) {
            press(`[data-toggle='${name}']`);
            const pressed = (seen()).hash;
            press(`[data-toggle='${name}']`);
            key(name[0]);
            out[name] = { hash: (seen()).hash, pressed };
            key(name[0].toUpperCase());
          }
          for (const name of ['ArrowLeft', 'ArrowRight', 'ArrowUp', 'ArrowDown', '+', '-']) {
            key(name);
            out[name] = seen();
            key('0');
            out['home' + name] = seen();
          }
          for (let k = 0; k < 100; k++) {
            key('ArrowUp');
          }
          out.pole = seen();
          const ignored = new KeyboardEvent('keydown', { key: 'l', ctrlKey: true, bubbles: true, cancelable: true });
          canvas.dispatchEvent(ignored);
          const other = new KeyboardEvent('keydown', { key: 'toString', bubbles: true, cancelable: true });
          canvas.dispatchEvent(other);
          out.taken = ignored.defaultPrevented || other.defaultPrevented;
          return out;
        }",
    );
    let start = hash(&seen, "start");
    assert_eq!(seen["focused"], true);
    for name in ["1", "2", "3", "lattice", "colour", "wireframe", "smooth"] {
        assert_eq!(*hash(&seen, name), seen[name]["pressed"], "{name}");
    }
    for name in ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "+", "-", "pole"] {
        assert_ne!(hash(&seen, name), start, "{name}");
    }
    for name in ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "+", "-"] {
        assert_eq!(hash(&seen, &format!("home{name}")), start, "back from {name}");
    }
    assert!(seen["+"]["drawn"].as_f64() > seen["-"]["drawn"].as_f64());
    assert!(seen["pole"]["drawn"].as_f64() > Some(0.05));
    assert_eq!(seen["taken"], false);
}

/// A tower is higher than wide whichever way is up, if that way is said.
#[cfg_attr(not(isochor_chromium), ignore = "needs Chromium: set ISOCHOR_CHROMIUM")]
#[test]
fn what_is_up_is_up() {
    let report = Story::twisted_cube().run().outcome.report;
    for (up, tall) in [(Axis::X, 0), (Axis::Y, 1), (Axis::Z, 2)] {
        let mesh = Story::twisted_cube().mesh;
        let mut points = mesh.points().to_vec();
        points.iter_mut().for_each(|p| p[tall] *= 4.0);
        let pose = ShownPose {
            name: "tower".into(),
            points: points.into(),
            lattice: None,
            volume: None,
            volume_change: None,
            stress: None,
        };
        let show = Show { faces: mesh.faces(), poses: vec![pose] };
        let contents =
            Page { title: "tower".into(), job: None, report: &report, pictures: Vec::new(), show: Some(&show), up };
        let seen = told_well(&page(&contents), "({ now: seen() })");
        let [width, height] = ["width", "height"].map(|side| seen["now"][side].as_f64().unwrap());
        assert!(height > 2.0 * width, "{up:?}: {width} by {height}");
    }
}

/// A page of a cube's job with nothing but its show.
fn shown<'a>(outcome: &'a Outcome, show: &'a Show) -> Page<'a> {
    Page {
        title: "cube".into(),
        job: None,
        report: &outcome.report,
        pictures: Vec::new(),
        show: Some(show),
        up: Axis::Z,
    }
}

/// Corrections along weak directions send controls millions of extents away.
#[cfg_attr(not(isochor_chromium), ignore = "needs Chromium: set ISOCHOR_CHROMIUM")]
#[test]
fn a_model_is_not_lost_in_a_lattice_that_is_far_larger() {
    let run = Story::twisted_cube().run();
    let mut show = run.show();
    show.poses[2].lattice.as_mut().unwrap().controls.to_mut()[7].x = 1e7;
    let contents = shown(&run.outcome, &show);
    let seen = told_well(&page(&contents), "({ now: seen() })");
    assert!(seen["now"]["drawn"].as_f64() > Some(0.05), "{seen}");
}

/// The springs of a net are more than the edges of its lattice, and held nodes are orange: what is drawn has more red than where none is held.
#[cfg_attr(not(isochor_chromium), ignore = "needs Chromium: set ISOCHOR_CHROMIUM")]
#[test]
fn springs_and_held_nodes_are_drawn() {
    let run = Story::settled().run();
    let seen = |held: bool| {
        let mut show = run.show();
        for pose in &mut show.poses {
            let springs = pose.lattice.as_mut().unwrap().net.as_mut().unwrap();
            springs.to_mut().is_held.iter_mut().for_each(|is_held| *is_held &= held);
        }
        let contents = shown(&run.outcome, &show);
        let toggle = "{ press(\"[data-toggle='colour']\"); const now = seen(); press(\"[data-toggle='lattice']\"); return { now, bare: seen() }; }";
        told_well(&page(&contents), toggle)
    };
    let (held, free) = (seen(true), seen(false));
    assert_ne!(held["now"]["hash"], held["bare"]["hash"]);
    assert_eq!(held["bare"]["hash"], free["bare"]["hash"]);
    let [more, less] = [&held, &free].map(|seen| seen["now"]["red"].as_f64().unwrap());
    assert!(more > less, "{more} and {less}");
}

/// Stretched, a cube gains volume everywhere; squashed, it loses it.
#[cfg_attr(not(isochor_chromium), ignore = "needs Chromium: set ISOCHOR_CHROMIUM")]
#[test]
fn gained_volume_is_red_and_lost_volume_blue() {
    for (scale, is_red) in [(1.8, true), (0.5, false)] {
        let job = format!("[[edit]]\nstretch = {{ axis = \"z\", scale = {scale} }}\n[preserve]\nvolume = \"free\"\n");
        let run = stories::run(Story::twisted_cube().mesh, &job);
        let show = run.show();
        let contents = shown(&run.outcome, &show);
        let seen = told_well(&page(&contents), "{ press(\"[data-toggle='lattice']\"); return { now: seen() }; }");
        let [red, blue] = ["red", "blue"].map(|name| seen["now"][name].as_f64().unwrap());
        assert!(if is_red { red > 1.3 * blue } else { blue > 1.3 * red }, "{scale}: {red} {blue}");
    }
}

#[cfg_attr(not(isochor_chromium), ignore = "needs Chromium: set ISOCHOR_CHROMIUM")]
#[test]
fn pages_of_all_kinds_of_jobs_open_without_a_word() {
    for story in Story::all() {
        let run = story.run();
        let show = run.show();
        let contents = Page {
            title: "story".into(),
            job: Some(story.job.into()),
            report: &run.outcome.report,
            pictures: Vec::new(),
            show: Some(&show),
            up: Axis::Z,
        };
        let seen = told_well(&page(&contents), "({ now: seen() })");
        assert!(seen["now"]["drawn"].as_f64() > Some(0.005), "{}: {seen}", story.job);
    }
}

#[cfg_attr(not(isochor_chromium), ignore = "needs Chromium: set ISOCHOR_CHROMIUM")]
#[test]
fn without_webgl_the_page_says_so_and_all_else_is_there() {
    let program = "{
      const shown = (selector) => getComputedStyle(document.querySelector(selector)).display !== 'none';
      return { state: figure.dataset.state, message: shown('.message'), canvas: shown('canvas'), buttons: shown('.buttons'),
        picture: document.querySelector('figure img').naturalWidth };
    }";
    let (told, _) = told(&twisted_page(), program, &["--disable-3d-apis"]);
    let expected = serde_json::json!(
        { "state": "no-webgl", "message": true, "canvas": false, "buttons": false, "picture": 1 });
    assert_eq!(told["result"], expected);
    assert_eq!((&told["violations"], &told["requests"]), (&serde_json::json!([]), &serde_json::json!([])));
}

/// The other way round: what the policy forbids is refused, so that none of the tests above passes for want of one.
#[cfg_attr(not(isochor_chromium), ignore = "needs Chromium: set ISOCHOR_CHROMIUM")]
#[test]
fn the_policy_refuses_network_and_other_programs() {
    let program = "{
      const refused = await fetch('http://127.0.0.1:9/').then(() => false, () => true);
      const script = document.createElement('script');
      script.textContent = 'window.ran = true';
      document.body.append(script);
      const image = new Image();
      await new Promise((done) => { image.onload = image.onerror = done; image.src = 'http://127.0.0.1:9/a.png'; });
      return { refused, ran: window.ran === true };
    }";
    let (told, _) = told(&twisted_page(), program, &[]);
    assert_eq!(told["result"], serde_json::json!({ "refused": true, "ran": false }));
    let violations = told["violations"].to_string();
    for directive in ["connect-src", "script-src", "img-src"] {
        assert!(violations.contains(directive), "{violations}");
    }
}

/// As wide as a phone, within a frame: a window of a browser without a screen is at least 500 pixels wide.
#[cfg_attr(not(isochor_chromium), ignore = "needs Chromium: set ISOCHOR_CHROMIUM")]
#[test]
fn nothing_sticks_out_on_a_phone() {
    let folder = tempfile::tempdir().unwrap();
    let run = Story::hollow().run();
    let show = run.show();
    let contents = Page {
        title: "a_name_without_any_place_to_break_it_that_is_longer_than_a_phone_is_wide".into(),
        job: Some("x".repeat(300)),
        report: &run.outcome.report,
        pictures: vec![Figure { caption: "one pixel".into(), png: STANDARD.decode(PIXEL).unwrap() }],
        show: Some(&show),
        up: Axis::Z,
    };
    let script = "const root = document.documentElement; addEventListener('load', () => parent.postMessage([innerWidth, root.scrollWidth - root.clientWidth], '*'));";
    let name = format!("script-src 'sha256-{}' ", STANDARD.encode(Sha256::digest(script)));
    let page = page(&contents).replacen("script-src ", &name, 1).replacen(
        "</head>",
        &format!("<script>{script}</script></head>"),
        1,
    );
    std::fs::write(folder.path().join("page.html"), page).unwrap();
    let mut host = String::from("<!DOCTYPE html><title>host</title><pre id=\"told\"></pre>");
    host +=
        "<script>addEventListener('message', (event) => { told.textContent = JSON.stringify(event.data); });</script>";
    write!(host, "<iframe src=\"page.html\" width=\"360\" height=\"700\" style=\"border:0\"></iframe>").unwrap();
    let file = folder.path().join("host.html");
    std::fs::write(&file, host).unwrap();
    let (document, log) = opened(&file, folder.path(), &[]);
    assert_eq!(text_told(&document), "[360,0]", "{log}");
}
