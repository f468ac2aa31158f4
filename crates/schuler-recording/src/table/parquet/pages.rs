//! What stands before the decoder of a column's pages: what a page says of its size is held to what it can have.
//!
//! The decoder reserves and fills what a page's header says, up to 2 GB for a page and 17 GB for a dictionary, before it
//! looks at what is there. And a page compressed by gzip or Brotli is decompressed to its end, whatever the header says of it, which
//! may be a million times its length.
use std::io::Read;
use std::sync::{Arc, Mutex, PoisonError};

use brotli::Decompressor;
use bytes::{Buf, Bytes};
use flate2::read::MultiGzDecoder;
use parquet::basic::{Compression, Type as Physical};
use parquet::column::reader::{ColumnReader, get_column_reader};
use parquet::errors::ParquetError;
use parquet::file::metadata::ParquetMetaData;
use parquet::file::reader::{ChunkReader, Length, SerializedPageReader};

use super::thrift::{Kept, PageHeader, contradicts};

/// What a value takes at most in a page, bytes: 8 for itself, 1 for its level, twice as much as it ever is.
const VALUE_BYTES: u64 = 16;
/// What a page may take beyond its values, bytes: blocks that are not full.
const PAGE_BYTES: u64 = 64 << 10;
/// What a dictionary may take beyond as many values as the group has rows, bytes: writers end it at 1 MB.
const DICTIONARY_BYTES: u64 = 1 << 20;

/// Buffer of the decompressor of Brotli.
const BUFFER_BYTES: usize = 1 << 12;

/// Types of pages.
const DATA_PAGE: u64 = 0;
const DICTIONARY_PAGE: u64 = 2;
const DATA_PAGE_V2: u64 = 3;

/// A reader of the column `column` in the row group `group`.
///
/// # Errors
/// Metadata that contradict each other. Of the reader: pages that do.
pub(super) fn column_reader<R: ChunkReader + 'static>(
    file: &Arc<R>,
    metadata: &ParquetMetaData,
    group: usize,
    column: usize,
) -> Result<ColumnReader, ParquetError> {
    let group = metadata.row_group(group);
    let rows = usize::try_from(group.num_rows())?;
    let column = group.column(column);
    let compression = column.compression();
    let pages = Pages {
        file: Arc::clone(file),
        length: file.len(),
        compression,
        physical: column.column_type(),
        rows: rows as u64,
        state: Mutex::new(State { left: rows as u64, dictionary: false, header: None }),
    };
    let plain = if pages.expands() {
        column.clone().into_builder().set_compression(Compression::UNCOMPRESSED).build()?
    } else {
        column.clone()
    };
    let reader = SerializedPageReader::new(Arc::new(pages), &plain, rows, None)?;
    Ok(get_column_reader(column.column_descr_ptr(), Box::new(reader)))
}

/// The bytes of a column in a row group. The decoder asks for a page's header, then for its content.
struct Pages<R> {
    file: Arc<R>,
    /// Length of the file.
    length: u64,
    compression: Compression,
    physical: Physical,
    /// Rows of the group.
    rows: u64,
    state: Mutex<State>,
}

struct State {
    /// Values that are left of the group's rows.
    left: u64,
    /// Whether there was a dictionary.
    dictionary: bool,
    /// The header that was read last.
    header: Option<PageHeader>,
}

impl<R: ChunkReader> Length for Pages<R> {
    fn len(&self) -> u64 {
        self.length
    }
}

impl<R: ChunkReader> ChunkReader for Pages<R> {
    type T = bytes::buf::Reader<Bytes>;

    fn get_read(&self, start: u64) -> Result<Self::T, ParquetError> {
        let left = self.length.checked_sub(start).ok_or_else(|| contradicts("a page beyond the end"))?;
        let header = PageHeader::read(self.file.get_read(start)?, left)?;
        let bytes = Bytes::copy_from_slice(&header.bytes);
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        self.check(&header, &mut state)?;
        state.header = Some(header);
        Ok(bytes.reader())
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes, ParquetError> {
        if start.checked_add(length as u64).is_none_or(|end| end > self.length) {
            return Err(contradicts(&format!("a page of {length} bytes that ends beyond the file")));
        }
        let bytes = self.file.get_bytes(start, length)?;
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        match state.header.take() {
            Some(header) if self.expands() => self.expand(&header, &bytes),
            _ => Ok(bytes),
        }
    }
}

impl<R> Pages<R> {
    /// Whether pages are decompressed here and not by the decoder, which would not stop at what the header says.
    fn expands(&self) -> bool {
        matches!(self.compression, Compression::GZIP(_) | Compression::BROTLI(_))
    }

    /// What a header says against what there can be.
    fn check(&self, header: &PageHeader, state: &mut State) -> Result<(), ParquetError> {
        let (most, values, bits) = match header.number(Kept::Type)? {
            page @ (DATA_PAGE | DATA_PAGE_V2) => {
                let kept = if page == DATA_PAGE { Kept::Values } else { Kept::ValuesV2 };
                let values = header.number(kept)?;
                state.left = state.left.checked_sub(values).ok_or_else(|| {
                    let left = state.left;
                    contradicts(&format!("a page of {values} values in a group that has {left} rows left"))
                })?;
                // A run of one value is as short for any number of them.
                (VALUE_BYTES.saturating_mul(values).saturating_add(PAGE_BYTES), values, 0)
            }
            DICTIONARY_PAGE => {
                if state.dictionary {
                    return Err(contradicts("two dictionaries of one column in a group"));
                }
                state.dictionary = true;
                let most = VALUE_BYTES.saturating_mul(self.rows).saturating_add(DICTIONARY_BYTES);
                (most, header.number(Kept::DictionaryValues)?, self.value_bits())
            }
            // An index, which is passed over.
            _ => return Ok(()),
        };
        let stored = header.number(Kept::CompressedBytes)?;
        let bytes = if self.is_compressed(header) { header.number(Kept::Bytes)? } else { stored };
        if self.is_compressed(header) {
            let possible = self.expansion().map_or(most, |ratio| most.min(stored.saturating_mul(ratio)));
            if bytes > possible {
                let found = format!("a page of {bytes} bytes, {stored} of them stored, for {values} values");
                return Err(contradicts(&found));
            }
        }
        if values.saturating_mul(bits) > bytes.saturating_mul(8) {
            return Err(contradicts(&format!("a dictionary of {values} values in {bytes} bytes")));
        }
        Ok(())
    }

    fn is_compressed(&self, header: &PageHeader) -> bool {
        // Pages of the second version may be left as they are, and say so.
        let left = header.get(Kept::Type) == Some(DATA_PAGE_V2) && header.get(Kept::Compressed) == Some(0);
        self.compression != Compression::UNCOMPRESSED && !left
    }

    /// Bits of a value in a dictionary.
    fn value_bits(&self) -> u64 {
        match self.physical {
            Physical::BOOLEAN => 1,
            Physical::INT32 | Physical::FLOAT => 32,
            _ => 64,
        }
    }

    /// How many bytes a compressed one can be at most; none where there is hardly a bound.
    fn expansion(&self) -> Option<u64> {
        match self.compression {
            // 64 bytes are copied by three.
            Compression::SNAPPY => Some(22),
            // A byte lengthens a copy by 255.
            Compression::LZ4 | Compression::LZ4_RAW => Some(255),
            // 258 bytes are copied by two bits.
            Compression::GZIP(_) => Some(1032),
            // A block of 128 kB is repeated from four bytes.
            Compression::ZSTD(_) => Some(1 << 15),
            _ => None,
        }
    }

    /// The content of a page, decompressed no further than its header says.
    fn expand(&self, header: &PageHeader, stored: &Bytes) -> Result<Bytes, ParquetError> {
        if !self.is_compressed(header) {
            return Ok(stored.clone());
        }
        let size = header.number(Kept::Bytes)?;
        // Levels of the second version stand before what is compressed.
        let levels = match header.get(Kept::Type) {
            Some(DATA_PAGE_V2) => {
                header.number(Kept::DefinitionBytes)? + header.number(Kept::RepetitionBytes)?
            }
            _ => 0,
        };
        let rest = size.checked_sub(levels).ok_or_else(|| contradicts("a page shorter than its levels"))?;
        let (levels, compressed) = usize::try_from(levels)
            .ok()
            .and_then(|levels| stored.split_at_checked(levels))
            .ok_or_else(|| contradicts("a page that ends in its levels"))?;
        let mut expanded = Vec::with_capacity(levels.len());
        expanded.extend_from_slice(levels);
        // One more than there should be; nothing at all stands for no values.
        if rest > 0 {
            match self.compression {
                Compression::GZIP(_) => {
                    MultiGzDecoder::new(compressed).take(rest + 1).read_to_end(&mut expanded)?
                }
                _ => Decompressor::new(compressed, BUFFER_BYTES).take(rest + 1).read_to_end(&mut expanded)?,
            };
        }
        if expanded.len() as u64 != size {
            return Err(contradicts(&format!("a page that has not the {size} bytes that it says it has")));
        }
        Ok(expanded.into())
    }
}
