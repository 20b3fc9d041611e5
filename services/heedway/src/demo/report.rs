//! What the demonstration ends with: a table, and in words what was not as it should be.

use super::judge::Finding;
use super::record::Record;

/// What the two runs should do, besides not colliding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Expected {
    /// Without the words, the short way breaks the rule.
    pub breaks_without: bool,
    /// With the words, the goal is still reached.
    pub reaches_with: bool,
}

/// The table of the runs.
#[must_use]
pub fn table(records: &[&Record]) -> String {
    let head = [
        "run",
        "reached",
        "time",
        "collisions",
        "rule kept",
        "least clearance",
        "path",
        "filter p50 / p99",
        "late ticks",
    ];
    let mut rows: Vec<Vec<String>> = vec![head.iter().map(|cell| (*cell).to_owned()).collect()];
    rows.extend(records.iter().map(|record| cells(record)));
    let n_columns = head.len();
    let widths: Vec<usize> = (0..n_columns)
        .map(|idx| {
            rows.iter().filter_map(|row| row.get(idx)).map(|cell| cell.chars().count()).max().unwrap_or(0)
        })
        .collect();
    let line = |row: &Vec<String>| {
        let padded = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}"));
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}

fn cells(record: &Record) -> Vec<String> {
    let ms = |share| record.filter_ms(share).map_or_else(|| "–".to_owned(), |ms| format!("{ms:.2}"));
    let (n_late, n_ticks) = record.late_ticks();
    vec![
        record.name.to_owned(),
        if record.reached_s.is_some() { "yes" } else { "no" }.to_owned(),
        format!("{:.1} s", record.reached_s.unwrap_or(record.time_s())),
        record.n_collisions.to_string(),
        match record.finding() {
            Finding::Kept => "yes".to_owned(),
            Finding::Broken(how) => format!("no ({how})"),
            Finding::NotJudged(_) => "not judged".to_owned(),
        },
        format!("{:.2} m", record.clearance_m_min),
        format!("{:.2} m", record.path_m()),
        format!("{} / {} ms", ms(0.5), ms(0.99)),
        format!("{n_late} of {n_ticks}"),
    ]
}

/// What was not as it should be; nothing when both runs did what they should.
#[must_use]
pub fn reasons(expected: &Expected, without: &Record, with: &Record) -> Vec<String> {
    let mut reasons = Vec::new();
    for (record, must_reach) in [(without, true), (with, expected.reaches_with)] {
        let name = record.name;
        if must_reach && record.reached_s.is_none() {
            reasons.push(format!("run {name}: the goal was not reached within {:.0} s", record.time_s()));
        }
        if record.n_collisions > 0 {
            reasons.push(format!("run {name}: {} collisions", record.n_collisions));
        }
    }
    if expected.breaks_without && !matches!(without.finding(), Finding::Broken(_)) {
        reasons.push(format!("run {}: the short way should have broken the rule", without.name));
    }
    match with.finding() {
        Finding::Broken(how) => reasons.push(format!("run {}: the rule was broken {how}", with.name)),
        // Said in the table; there is nothing to hold against the robot.
        Finding::Kept | Finding::NotJudged(_) => {}
    }
    reasons
}

#[cfg(test)]
mod tests {
    use super::super::judge::Judge;
    use super::*;

    fn record(name: &'static str, reached_s: Option<f64>, n_collisions: u64) -> Record {
        let mut record = Record::new(name, Judge::default());
        (record.reached_s, record.n_collisions) = (reached_s, n_collisions);
        record
    }

    const OPEN: Expected = Expected { breaks_without: false, reaches_with: true };

    #[test]
    fn two_good_runs_leave_nothing_to_say() {
        let (without, with) = (record("without", Some(7.0), 0), record("with", Some(9.0), 0));
        assert_eq!(reasons(&OPEN, &without, &with), [""; 0]);
    }

    #[test]
    fn each_thing_that_goes_wrong_is_said() {
        let check = |expected: Expected, without: Record, with: Record, wanted: &str| {
            let said = reasons(&expected, &without, &with);
            assert!(said.len() == 1 && said[0].contains(wanted), "{said:?}, wanted {wanted:?}");
        };
        let good = |name| record(name, Some(7.0), 0);
        check(OPEN, record("without", None, 0), good("with"), "run without: the goal was not reached");
        check(OPEN, good("without"), record("with", None, 0), "run with: the goal was not reached");
        check(OPEN, good("without"), record("with", Some(7.0), 2), "run with: 2 collisions");
        let strict = Expected { breaks_without: true, ..OPEN };
        check(strict, good("without"), good("with"), "should have broken the rule");
    }

    #[test]
    fn a_planner_that_does_not_see_rules_need_not_reach_the_goal() {
        let expected = Expected { reaches_with: false, ..OPEN };
        let said = reasons(&expected, &record("without", Some(7.0), 0), &record("with", None, 0));
        assert_eq!(said, [""; 0]);
    }

    #[test]
    fn the_columns_of_the_table_line_up() {
        let (without, with) = (record("without", Some(7.0), 0), record("with", None, 13));
        let text = table(&[&without, &with]);
        let places: Vec<Option<usize>> =
            text.lines().zip(["collisions", "0", "13"]).map(|(line, cell)| line.find(cell)).collect();
        assert_eq!(text.lines().count(), 3);
        assert!(text.contains("without  yes"), "{text}");
        assert_eq!(places[0], places[2], "{text}");
    }
}
