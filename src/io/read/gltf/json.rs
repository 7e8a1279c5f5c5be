//! Looking into the JSON of a document: what is absent, what is of the wrong type.

use serde_json::Value;

use super::super::build::Kind;
use super::super::error::ReadErrorKind;

fn wrong(key: &str, wanted: &str) -> Kind {
    ReadErrorKind::Syntax(format!("`{key}` is not {wanted}; mend the document"))
}

/// An array, empty when absent.
pub(super) fn list<'v>(value: &'v Value, key: &str) -> Result<&'v [Value], Kind> {
    match value.get(key) {
        None | Some(Value::Null) => Ok(&[]),
        Some(Value::Array(items)) => Ok(items),
        Some(_) => Err(wrong(key, "an array")),
    }
}

/// A whole number from 0.
pub(super) fn uint(value: &Value, key: &str) -> Result<Option<u64>, Kind> {
    value.get(key).map(|v| as_uint(v).ok_or_else(|| wrong(key, "a whole number from 0"))).transpose()
}

/// The same for a value itself; `3.0` will do.
pub(super) fn as_uint(value: &Value) -> Option<u64> {
    value.as_u64().or_else(|| {
        let number = value.as_f64()?;
        (number.fract() == 0.0 && (0.0..9.0e15).contains(&number)).then_some(number as u64)
    })
}

/// A whole number that has to be there.
pub(super) fn needed(value: &Value, key: &str) -> Result<u64, Kind> {
    uint(value, key)?.ok_or_else(|| ReadErrorKind::Syntax(format!("`{key}` is missing; mend the document")))
}

/// A number that has to be an index into `list` items of `what`.
pub(super) fn index(value: &Value, key: &str, count: usize, what: &str) -> Result<Option<usize>, Kind> {
    uint(value, key)?.map(|i| in_range(i, count, what)).transpose()
}

/// `i` as an index into `count` items of `what`.
pub(super) fn in_range(i: u64, count: usize, what: &str) -> Result<usize, Kind> {
    let missing = || ReadErrorKind::Syntax(format!("{what}[{i}] is named, but there are {count}; mend the document"));
    usize::try_from(i).ok().filter(|&i| i < count).ok_or_else(missing)
}

/// A string.
pub(super) fn text<'v>(value: &'v Value, key: &str) -> Result<Option<&'v str>, Kind> {
    value.get(key).map(|v| v.as_str().ok_or_else(|| wrong(key, "a string"))).transpose()
}

/// An array of `N` numbers.
pub(super) fn numbers<const N: usize>(value: &Value, key: &str) -> Result<Option<[f64; N]>, Kind> {
    let Some(v) = value.get(key) else { return Ok(None) };
    let bad = || wrong(key, &format!("an array of {N} numbers"));
    let items = v.as_array().filter(|a| a.len() == N).ok_or_else(bad)?;
    let mut out = [0.0; N];
    for (o, item) in out.iter_mut().zip(items) {
        *o = item.as_f64().ok_or_else(bad)?;
    }
    Ok(Some(out))
}
