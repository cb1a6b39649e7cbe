//! Buffer views and accessors: typed access to the numbers in buffers.

use super::super::error::SceneError;
use super::json::Cursor;

/// Largest number of elements of an accessor without data in a buffer.
const MOST_ZEROS: u64 = 1 << 24;

/// A part of a buffer.
struct View {
    buffer: usize,
    offset: usize,
    length: usize,
    stride: Option<usize>,
}

/// Type of one component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn read(cursor: &Cursor<'_>) -> Result<Self, SceneError> {
        Ok(match cursor.integer()? {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => {
                return Err(cursor.error("5120, 5121, 5122, 5123, 5125 or 5126 is accepted"));
            }
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// Returns the value, scaled to -1..1 or 0..1 if `normalized`.
    fn value(self, bytes: &[u8], normalized: bool) -> Option<f64> {
        let (value, full) = match self {
            Self::I8 => (f64::from(i8::from_le_bytes(bytes.try_into().ok()?)), 127.0),
            Self::U8 => (f64::from(u8::from_le_bytes(bytes.try_into().ok()?)), 255.0),
            Self::I16 => (f64::from(i16::from_le_bytes(bytes.try_into().ok()?)), 32767.0),
            Self::U16 => (f64::from(u16::from_le_bytes(bytes.try_into().ok()?)), 65535.0),
            Self::U32 => (f64::from(u32::from_le_bytes(bytes.try_into().ok()?)), 1.0),
            Self::F32 => (f64::from(f32::from_le_bytes(bytes.try_into().ok()?)), 1.0),
        };
        Some(if normalized { (value / full).max(-1.0) } else { value })
    }
}

/// An accessor: position and type of its elements.
pub(super) struct Accessor<'a> {
    pub(super) cursor: Cursor<'a>,
    pub(super) count: usize,
    kind: &'a str,
    component: Component,
    normalized: bool,
    base: Option<(usize, usize)>,
    sparse: Option<Sparse>,
}

/// Elements that replace others, by index.
struct Sparse {
    count: usize,
    index: Component,
    indices: (usize, usize),
    values: (usize, usize),
}

impl Accessor<'_> {
    /// Returns the offsets of the components in an element, and the size of an element.
    fn layout(&self) -> (Vec<usize>, usize) {
        let size = self.component.size();
        let (columns, rows) = match self.kind {
            "VEC2" => (1_usize, 2_usize),
            "VEC3" => (1, 3),
            "VEC4" => (1, 4),
            "MAT2" => (2, 2),
            "MAT3" => (3, 3),
            "MAT4" => (4, 4),
            _ => (1, 1),
        };
        let mut column = rows.saturating_mul(size);
        if columns > 1 {
            // Columns of a matrix start at multiples of four bytes.
            column = column.next_multiple_of(4);
        }
        let offsets = (0..columns)
            .flat_map(|c| (0..rows).map(move |r| (c, r)))
            .map(|(c, r)| c.saturating_mul(column).saturating_add(r.saturating_mul(size)))
            .collect();
        (offsets, columns.saturating_mul(column))
    }

    /// Returns the index that restarts a primitive; `None` if the component type cannot hold
    /// indices.
    pub(super) fn restart(&self) -> Option<u32> {
        match self.component {
            Component::U8 => Some(0xff),
            Component::U16 => Some(0xffff),
            Component::U32 => Some(u32::MAX),
            _ => None,
        }
    }

    pub(super) fn is_float(&self) -> bool {
        self.component == Component::F32
    }

    pub(super) fn kind(&self) -> &str {
        self.kind
    }
}

/// All buffer views and accessors of a file.
pub(super) struct Accessors<'a> {
    buffers: &'a [Option<Vec<u8>>],
    views: Vec<View>,
    pub(super) all: Vec<Accessor<'a>>,
}

impl<'a> Accessors<'a> {
    /// Reads and checks every view, every accessor, and all float data.
    pub(super) fn read(
        root: &Cursor<'a>,
        buffers: &'a [Option<Vec<u8>>],
    ) -> Result<Self, SceneError> {
        let sizes = root
            .list("buffers")?
            .iter()
            .map(|b| b.require("byteLength")?.integer())
            .collect::<Result<Vec<u64>, _>>()?;
        let mut this = Self { buffers, views: Vec::new(), all: Vec::new() };
        for view in root.list("bufferViews")? {
            this.views.push(read_view(&view, &sizes)?);
        }
        for cursor in root.list("accessors")? {
            let accessor = this.read_accessor(cursor)?;
            this.all.push(accessor);
        }
        for accessor in &this.all {
            if accessor.is_float() {
                this.each(accessor, |_, _| Ok(()))?;
            }
        }
        Ok(this)
    }

    fn read_accessor(&self, cursor: Cursor<'a>) -> Result<Accessor<'a>, SceneError> {
        let component = Component::read(&cursor.require("componentType")?)?;
        let count_cursor = cursor.require("count")?;
        let count = count_cursor.integer()?;
        let kind_cursor = cursor.require("type")?;
        let kind = kind_cursor.text()?;
        if !matches!(kind, "SCALAR" | "VEC2" | "VEC3" | "VEC4" | "MAT2" | "MAT3" | "MAT4") {
            return Err(kind_cursor.error("SCALAR, VEC2..VEC4 or MAT2..MAT4 is accepted"));
        }
        let normalized = cursor.get("normalized")?.map_or(Ok(false), |n| n.boolean())?;
        let mut accessor = Accessor {
            count: usize::try_from(count).unwrap_or(usize::MAX),
            kind,
            component,
            normalized,
            base: None,
            sparse: None,
            cursor: cursor.clone(),
        };
        if count == 0 {
            return Err(count_cursor.error("at least 1 is accepted"));
        }
        let (_, size) = accessor.layout();
        accessor.base = match cursor.get("bufferView")? {
            Some(view) => {
                let index = view.index(self.views.len(), "buffer views")?;
                let offset = cursor.get("byteOffset")?;
                let offset = offset.map_or(Ok(0), |o| o.integer())?;
                let stride = self.views.get(index).and_then(|v| v.stride).unwrap_or(size);
                if stride < size {
                    return Err(view.fault(
                        format!("byteStride {stride} of the buffer view of {}", cursor.name()),
                        format!("at least the {size} bytes of an element are accepted"),
                    ));
                }
                self.fits(&count_cursor, index, offset, stride, size, count)?;
                Some((index, usize::try_from(offset).unwrap_or(usize::MAX)))
            }
            None => {
                if let Some(offset) = cursor.get("byteOffset")? {
                    return Err(offset.error("an accessor without 'bufferView' has none"));
                }
                if count > MOST_ZEROS {
                    let most = format!("up to {MOST_ZEROS} is accepted without a 'bufferView'");
                    return Err(count_cursor.error(most));
                }
                None
            }
        };
        if let Some(sparse) = cursor.get("sparse")? {
            accessor.sparse = Some(self.read_sparse(&sparse, count, size)?);
        }
        Ok(accessor)
    }

    fn read_sparse(
        &self,
        sparse: &Cursor<'_>,
        elements: u64,
        size: usize,
    ) -> Result<Sparse, SceneError> {
        let count_cursor = sparse.require("count")?;
        let count = count_cursor.integer()?;
        if count == 0 || count > elements {
            return Err(count_cursor.error(format!("1..{elements} is accepted")));
        }
        let part = |key: &str, size: Option<usize>| -> Result<_, SceneError> {
            let part = sparse.require(key)?;
            let component = match size {
                None => Some(Component::read(&part.require("componentType")?)?),
                Some(_) => None,
            };
            let size = size.or(component.map(Component::size)).unwrap_or(1);
            let view = part.require("bufferView")?.index(self.views.len(), "buffer views")?;
            let offset = part.get("byteOffset")?.map_or(Ok(0), |o| o.integer())?;
            self.fits(&count_cursor, view, offset, size, size, count)?;
            Ok((component, (view, usize::try_from(offset).unwrap_or(usize::MAX))))
        };
        let (component, indices) = part("indices", None)?;
        let index = component.unwrap_or(Component::U32);
        if !matches!(index, Component::U8 | Component::U16 | Component::U32) {
            let at = sparse.require("indices")?.require("componentType")?;
            return Err(at.error("5121, 5123 or 5125 is accepted"));
        }
        let (_, values) = part("values", Some(size))?;
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        Ok(Sparse { count, index, indices, values })
    }

    /// Checks that `count` elements of `size` bytes, `stride` apart, lie inside a view.
    fn fits(
        &self,
        at: &Cursor<'_>,
        view: usize,
        offset: u64,
        stride: usize,
        size: usize,
        count: u64,
    ) -> Result<(), SceneError> {
        let length = self.views.get(view).map_or(0, |v| v.length) as u64;
        let end = count
            .checked_sub(1)
            .and_then(|last| last.checked_mul(stride as u64))
            .and_then(|start| start.checked_add(size as u64))
            .and_then(|end| end.checked_add(offset));
        match end {
            Some(end) if end <= length => Ok(()),
            _ => Err(at.error(format!(
                "elements of {size} bytes, {stride} apart from byte {offset} on, must fit into \
                 the {length} bytes of buffer view {view}"
            ))),
        }
    }

    /// Returns the accessor at an index.
    pub(super) fn get(&self, cursor: &Cursor<'_>) -> Result<&Accessor<'a>, SceneError> {
        let index = cursor.index(self.all.len(), "accessors")?;
        self.all.get(index).ok_or_else(|| cursor.error("an accessor of the file is accepted"))
    }

    /// Returns true if the data of an accessor is known.
    pub(super) fn has_data(&self, accessor: &Accessor<'_>) -> bool {
        let known = |view: usize| {
            let buffer = self.views.get(view).and_then(|v| self.buffers.get(v.buffer));
            buffer.is_some_and(Option::is_some)
        };
        accessor.base.is_none_or(|(view, _)| known(view))
            && accessor.sparse.as_ref().is_none_or(|s| known(s.indices.0) && known(s.values.0))
    }

    fn bytes(&self, (view, offset): (usize, usize)) -> Option<&[u8]> {
        let view = self.views.get(view)?;
        let buffer = self.buffers.get(view.buffer)?.as_deref()?;
        let whole = buffer.get(view.offset..view.offset.checked_add(view.length)?)?;
        whole.get(offset..)
    }

    /// Visits the elements as f64. Visits none if the data is unknown.
    fn each(
        &self,
        accessor: &Accessor<'_>,
        mut visit: impl FnMut(usize, &[f64]) -> Result<(), SceneError>,
    ) -> Result<(), SceneError> {
        if !self.has_data(accessor) {
            return Ok(());
        }
        let (offsets, size) = accessor.layout();
        let component = accessor.component;
        let mut element = Vec::with_capacity(offsets.len());
        let take = |bytes: &[u8], element: &mut Vec<f64>| -> Option<()> {
            element.clear();
            for offset in &offsets {
                let part = bytes.get(*offset..offset.checked_add(component.size())?)?;
                element.push(component.value(part, accessor.normalized)?);
            }
            Some(())
        };
        let cut = || accessor.cursor.fault(accessor.cursor.name(), "its elements end too early");
        let bad = |index: usize, element: &[f64]| {
            let text = format!("element {index} of {} = {element:?}", accessor.cursor.name());
            accessor.cursor.fault(text, "finite numbers are accepted")
        };

        // Replacements in order of their index, so that one pass over the elements suffices.
        let mut replaced: Vec<(usize, usize)> = Vec::new();
        if let Some(sparse) = &accessor.sparse {
            let bytes = self.bytes(sparse.indices).ok_or_else(cut)?;
            let width = sparse.index.size();
            for (order, part) in bytes.chunks_exact(width).take(sparse.count).enumerate() {
                let index = sparse.index.value(part, false).ok_or_else(cut)? as usize;
                let ascending = replaced.last().is_none_or(|(last, _)| *last < index);
                if index >= accessor.count || !ascending {
                    return Err(accessor.cursor.fault(
                        format!("sparse index {order} of {} = {index}", accessor.cursor.name()),
                        format!("ascending indices below {} are accepted", accessor.count),
                    ));
                }
                replaced.push((index, order));
            }
        }
        let mut replaced = replaced.into_iter().peekable();
        let base = match accessor.base {
            Some(place) => {
                let stride = self.views.get(place.0).and_then(|v| v.stride).unwrap_or(size);
                Some((self.bytes(place).ok_or_else(cut)?, stride))
            }
            None => None,
        };
        let values = match &accessor.sparse {
            Some(sparse) => Some(self.bytes(sparse.values).ok_or_else(cut)?),
            None => None,
        };
        for index in 0..accessor.count {
            let sparse = replaced.next_if(|(at, _)| *at == index);
            let bytes = match (sparse, base) {
                (Some((_, order)), _) => {
                    values.and_then(|bytes| bytes.get(order.checked_mul(size)?..))
                }
                (None, Some((bytes, stride))) => {
                    index.checked_mul(stride).and_then(|start| bytes.get(start..))
                }
                (None, None) => None,
            };
            match bytes {
                Some(bytes) => take(bytes, &mut element).ok_or_else(cut)?,
                None if base.is_some() || sparse.is_some() => return Err(cut()),
                None => {
                    element.clear();
                    element.resize(offsets.len(), 0.0);
                }
            }
            if !element.iter().all(|x| x.is_finite()) {
                return Err(bad(index, &element));
            }
            visit(index, &element)?;
        }
        Ok(())
    }

    /// Returns the elements as arrays of `N` numbers.
    pub(super) fn elements<const N: usize>(
        &self,
        accessor: &Accessor<'_>,
    ) -> Result<Vec<[f64; N]>, SceneError> {
        if !self.has_data(accessor) {
            return Err(accessor.cursor.fault(
                format!("{}, whose buffer has no data", accessor.cursor.name()),
                "a buffer with a 'uri' or the BIN chunk is required",
            ));
        }
        let mut elements = Vec::new();
        self.each(accessor, |_, element| {
            let element = element.try_into().map_err(|_| {
                let kind = accessor.kind();
                accessor.cursor.fault(format!("type {kind}"), format!("{N} components"))
            })?;
            elements.push(element);
            Ok(())
        })?;
        Ok(elements)
    }
}

fn read_view(view: &Cursor<'_>, sizes: &[u64]) -> Result<View, SceneError> {
    let buffer = view.require("buffer")?.index(sizes.len(), "buffers")?;
    let size = sizes.get(buffer).copied().unwrap_or(0);
    let length_cursor = view.require("byteLength")?;
    let length = length_cursor.integer()?;
    let offset = view.get("byteOffset")?.map_or(Ok(0), |o| o.integer())?;
    if length == 0 || offset.checked_add(length).is_none_or(|end| end > size) {
        let at = view.get("byteOffset")?.filter(|_| offset >= size).unwrap_or(length_cursor);
        return Err(at.error(format!(
            "at least 1 byte inside the {size} bytes of buffer {buffer} is accepted"
        )));
    }
    let stride = match view.get("byteStride")? {
        Some(cursor) => {
            let stride = cursor.integer()?;
            if !(4..=252).contains(&stride) || !stride.is_multiple_of(4) || stride > length {
                return Err(cursor.error(format!(
                    "multiples of 4 from 4 to 252 and up to the byteLength {length} are accepted"
                )));
            }
            usize::try_from(stride).ok()
        }
        None => None,
    };
    let fit = |x: u64| usize::try_from(x).unwrap_or(usize::MAX);
    Ok(View { buffer, offset: fit(offset), length: fit(length), stride })
}
