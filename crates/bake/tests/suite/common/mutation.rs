//! Fuzzing of readers with seeded mutations of a corpus, bounded in number and time.
//!
//! `DRYSTONE_FUZZ` sets the number of inputs per test, `DRYSTONE_FUZZ_SEED` their seed.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

/// Inputs per test unless `DRYSTONE_FUZZ` says otherwise.
const INPUTS: u64 = 2000;
/// Longest time that reading an input may take: ten times that of an idle machine, so that only a
/// hang exceeds it. \[s\]
const LONGEST: f64 = 20.0;

fn variable(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() % count.max(1) as u64) as usize
    }

    fn pick<'a, T>(&mut self, from: &'a [T]) -> &'a T {
        &from[self.below(from.len())]
    }
}

/// Runs `read` on mutations of the corpus. It may refuse any input, but must neither panic nor take
/// longer than `LONGEST`. An input that makes it do so is left in the folder for temporary files,
/// and named.
pub(crate) fn fuzz(name: &str, corpus: &[Vec<u8>], json: bool, read: impl Fn(&[u8])) {
    let inputs = variable("DRYSTONE_FUZZ", INPUTS);
    let seed = variable("DRYSTONE_FUZZ_SEED", 1);
    let start = Instant::now();
    for number in 0..inputs {
        let mut random = Random(seed.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(number));
        let input = mutated(corpus, json, &mut random);
        try_one(&format!("{name}-{seed}-{number}"), &input, &read);
    }
    println!("{name}: {inputs} inputs in {:.1} s", start.elapsed().as_secs_f64());
}

/// Runs `read` on one input, with the same demands as [`fuzz`].
pub(crate) fn try_one(name: &str, input: &[u8], read: impl Fn(&[u8])) {
    let start = Instant::now();
    let read = std::panic::AssertUnwindSafe(|| read(input));
    let outcome = std::panic::catch_unwind(read);
    let time = start.elapsed();
    if outcome.is_err() || time > Duration::from_secs_f64(LONGEST) {
        let path = std::env::temp_dir().join(format!("drystone-fault-{name}"));
        std::fs::write(&path, input).unwrap();
        let what = if outcome.is_err() { "a panic" } else { "too long" };
        panic!("{what} after {:.2} s: {}", time.as_secs_f64(), path.display());
    }
}

fn mutated(corpus: &[Vec<u8>], json: bool, random: &mut Random) -> Vec<u8> {
    let mut input = random.pick(corpus).clone();
    // Most inputs have changed values, which get farther in a reader than broken syntax.
    if json
        && random.below(4) != 0
        && let Ok(mut document) = serde_json::from_slice(&input)
    {
        for _ in 0..=random.below(3) {
            change_value(&mut document, random);
        }
        input = serde_json::to_vec(&document).unwrap();
        if random.below(4) != 0 {
            return input;
        }
    }
    for _ in 0..=random.below(4) {
        change_bytes(&mut input, corpus, random);
    }
    input
}

/// Changes a random value of a document.
fn change_value(document: &mut Value, random: &mut Random) {
    let other = {
        let mut place = &*document;
        while let Some(inner) = child(place, random).filter(|_| random.below(4) != 0) {
            place = inner;
        }
        place.clone()
    };
    let mut place = document;
    loop {
        let count = match &*place {
            Value::Array(items) => items.len(),
            Value::Object(items) => items.len(),
            _ => 0,
        };
        if count == 0 || random.below(6) == 0 {
            break;
        }
        let index = random.below(count);
        place = match place {
            Value::Array(items) => &mut items[index],
            Value::Object(items) => items.values_mut().nth(index).unwrap(),
            _ => unreachable!(),
        };
    }
    change(place, other, random);
}

fn child<'a>(value: &'a Value, random: &mut Random) -> Option<&'a Value> {
    match value {
        Value::Array(items) if !items.is_empty() => Some(random.pick(items)),
        Value::Object(items) if !items.is_empty() => items.values().nth(random.below(items.len())),
        _ => None,
    }
}

fn change(place: &mut Value, other: Value, random: &mut Random) {
    const NUMBERS: [f64; 14] = [
        0.0,
        -0.0,
        -1.0,
        0.5,
        1e-320,
        1e-30,
        1e30,
        1e300,
        -1e300,
        255.0,
        65535.0,
        4294967295.0,
        4294967296.0,
        1.8446744073709552e19,
    ];
    match (random.below(8), &mut *place) {
        (0 | 1, Value::Array(items)) if !items.is_empty() => {
            let index = random.below(items.len());
            let item = items[index].clone();
            match random.below(3) {
                0 => drop(items.remove(index)),
                1 => items.insert(index, item),
                _ => items.truncate(index),
            }
        }
        (0 | 1, Value::Object(items)) if !items.is_empty() => {
            let key = items.keys().nth(random.below(items.len())).unwrap().clone();
            let value = items.remove(&key).unwrap();
            if random.below(2) == 0 {
                items.insert(format!("{key}s"), value);
            }
        }
        (2 | 3, Value::Number(number)) => {
            let near = number.as_f64().unwrap_or(0.0);
            let whole = number.as_i64().unwrap_or(0);
            *place = match random.below(4) {
                0 => json!(near * 1.5),
                1 => json!(-near),
                2 => json!(whole.wrapping_add(1)),
                _ => json!(whole.wrapping_sub(1)),
            };
        }
        (4, _) => *place = json!(random.pick(&[u64::MAX, u64::MAX / 2, 1 << 32, 1 << 53, 3, 0])),
        (5, _) => *place = other,
        (6, _) => {
            let odd = [json!(null), json!([]), json!({}), json!(""), json!("inf"), json!(true)];
            *place = random.pick(&odd).clone();
        }
        _ => *place = json!(random.pick(&NUMBERS)),
    }
}

fn change_bytes(input: &mut Vec<u8>, corpus: &[Vec<u8>], random: &mut Random) {
    const WORDS: [&[u8]; 16] = [
        b"-1",
        b"0",
        b"1e999",
        b"nan",
        b"inf",
        b"18446744073709551616",
        b"1e-320",
        b"null",
        b"[[[[",
        b"}}",
        b"\"",
        b"\\u0000",
        b"\xff\xfe",
        b"\0\0\0\0",
        b"\xff\xff\xff\xff",
        b"\xff\xff\xff\x7f",
    ];
    let at = random.below(input.len() + 1);
    let end = (at + 1 + random.below(32)).min(input.len());
    match random.below(8) {
        0 if at < input.len() => input[at] ^= 1 << random.below(8),
        1 if at < input.len() => input[at] = *random.pick(&[0, 1, 0x7f, 0x80, 0xff, b'9', b'-']),
        2 => drop(input.drain(at.min(end)..end)),
        3 => {
            let piece = input[at.min(end)..end].to_vec();
            input.splice(at..at, piece);
        }
        4 => input.truncate(at),
        5 => {
            let word = random.pick(&WORDS);
            let end = (at + word.len() * random.below(2)).min(input.len());
            input.splice(at..end, word.iter().copied());
        }
        6 => {
            let other = random.pick(corpus);
            let from = random.below(other.len() + 1);
            let piece = &other[from..(from + random.below(64)).min(other.len())];
            input.splice(at..at, piece.iter().copied());
        }
        _ => {
            // Replaces a number by another.
            let digits = |byte: &u8| byte.is_ascii_digit();
            if let Some(start) = input[at..].iter().position(digits).map(|start| at + start) {
                let length = input[start..].iter().take_while(|byte| digits(byte)).count();
                let word = random.pick(&WORDS[..7]);
                input.splice(start..start + length, word.iter().copied());
            }
        }
    }
}
