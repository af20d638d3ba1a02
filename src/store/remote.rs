//! Stores by the crate `object_store`.

use std::{
    ops::Range,
    sync::Arc,
    time::{Duration, Instant},
};

use async_trait::async_trait;
use futures::{StreamExt as _, TryStreamExt as _};
use object_store::{
    BackoffConfig, ClientOptions, Error, GetOptions, GetRange, ObjectMeta, ObjectStore, ObjectStoreExt as _,
    PutMode, PutOptions, PutPayload, RetryConfig,
    aws::AmazonS3Builder,
    azure::MicrosoftAzureBuilder,
    client::{
        HttpClient, HttpConnector, HttpError, HttpRequest, HttpResponse, HttpService, ReqwestConnector,
    },
    gcp::GoogleCloudStorageBuilder,
    http::HttpBuilder,
    path::Path,
};
use tokio::runtime::{Builder, Runtime};

use super::{Bucket, Created, ObjectFacts, Scheme, StoreError, Traffic, Uri, bucket::Sink};

/// Requests of one command at a time.
const AT_ONCE: usize = 4;
/// Times that a request is sent again.
const RETRIES: usize = 10;
/// Time after which it is not sent again, seconds; `ARTITWIN_STORE_PATIENCE_S` says another.
const PATIENCE_S: u64 = 180;
/// Time that one request may take: pieces that are read have 8 MiB, files of a result up to some hundred.
const REQUEST: Duration = Duration::from_secs(180);
const CONNECT: Duration = Duration::from_secs(10);
/// Connections that nobody used so long are closed, as the work between reading and writing takes minutes.
const IDLE: Duration = Duration::from_secs(15);

/// A store and the thread's runtime.
pub struct Remote {
    store: Arc<dyn ObjectStore>,
    root: String,
    runtime: Runtime,
    traffic: Arc<Traffic>,
}

impl Remote {
    /// Connects by the environment, as `object_store` reads it: `AWS_ENDPOINT`, `GOOGLE_...`, `AZURE_...`.
    ///
    /// # Errors
    /// [`StoreError::Access`].
    pub fn connect(uri: &Uri, traffic: &Arc<Traffic>) -> Result<Self, StoreError> {
        // An error says that another part of the process chose one before.
        rustls::crypto::ring::default_provider().install_default().ok();
        let store = store(uri, traffic)
            .map_err(|source| StoreError::Access { uri: uri.root.clone(), source: source.into() })?;
        Self::over(store, &uri.root, traffic)
    }

    /// Over a store that is there.
    ///
    /// # Errors
    /// [`StoreError::Access`] where no runtime can be made.
    pub fn over(store: Arc<dyn ObjectStore>, root: &str, traffic: &Arc<Traffic>) -> Result<Self, StoreError> {
        let runtime = Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(|source| StoreError::Access { uri: root.to_owned(), source: source.into() })?;
        Ok(Self { store, root: root.to_owned(), runtime, traffic: Arc::clone(traffic) })
    }

    fn failed(&self, path: &str, source: Error) -> StoreError {
        StoreError::Access { uri: format!("{}/{path}", self.root), source: source.into() }
    }

    fn path(&self, path: &str) -> Result<Path, StoreError> {
        Path::parse(path).map_err(|source| self.failed(path, source.into()))
    }

    fn wait<T>(&self, work: impl Future<Output = T>) -> T {
        let begun = Instant::now();
        let out = self.runtime.block_on(work);
        Traffic::add(&self.traffic.nanos, begun.elapsed().as_nanos() as u64);
        out
    }

    /// One range of an object.
    async fn piece(
        &self,
        path: &Path,
        object: &ObjectFacts,
        range: Range<u64>,
    ) -> Result<bytes::Bytes, Error> {
        // What came is of one state of the object, or nothing is.
        let options = GetOptions {
            range: Some(GetRange::Bounded(range.clone())),
            if_match: object.etag.clone(),
            ..GetOptions::default()
        };
        let bytes = self.store.get_opts(path, options).await?.bytes().await?;
        if bytes.len() as u64 != range.end - range.start {
            let text = format!("{} bytes came in place of {}", bytes.len(), range.end - range.start);
            return Err(Error::Generic { store: "range", source: text.into() });
        }
        Ok(bytes)
    }

    /// Writes one object, unless there is one of its name.
    async fn create_one(&self, path: &Path, bytes: Vec<u8>) -> Result<Created, Error> {
        let count = bytes.len() as u64;
        let payload = PutPayload::from(bytes);
        let options = PutOptions::from(PutMode::Create);
        let done = match self.store.put_opts(path, payload.clone(), options).await {
            // A store without conditional writes: looked at first, which leaves a gap of one request.
            Err(Error::NotImplemented { .. } | Error::NotSupported { .. }) => {
                match self.store.head(path).await {
                    Err(Error::NotFound { .. }) => self.store.put(path, payload).await,
                    Ok(_) => return Ok(Created::Stood),
                    Err(error) => return Err(error),
                }
            }
            other => other,
        };
        match done {
            Ok(_) => {
                Traffic::add(&self.traffic.bytes_written, count);
                Ok(Created::New)
            }
            Err(Error::AlreadyExists { .. } | Error::Precondition { .. }) => Ok(Created::Stood),
            Err(error) => Err(error),
        }
    }
}

fn facts(meta: ObjectMeta) -> ObjectFacts {
    let tag = [meta.e_tag.clone(), meta.version].map(Option::unwrap_or_default).join(" ").trim().to_owned();
    // Without either, the time of the last change is what there is.
    let tag = if tag.is_empty() { meta.last_modified.to_rfc3339() } else { tag };
    ObjectFacts { path: meta.location.to_string(), bytes: meta.size, tag, etag: meta.e_tag }
}

impl Bucket for Remote {
    fn head(&self, path: &str) -> Result<Option<ObjectFacts>, StoreError> {
        let at = self.path(path)?;
        match self.wait(self.store.head(&at)) {
            Ok(meta) => Ok(Some(facts(meta))),
            Err(Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(self.failed(path, error)),
        }
    }

    fn list(&self, prefix: &str, limit: usize) -> Result<Vec<ObjectFacts>, StoreError> {
        let at = self.path(prefix)?;
        let mut objects = self
            .wait(async {
                // One beyond the limit shows that there are more.
                self.store.list(Some(&at)).take(limit + 1).map_ok(facts).try_collect::<Vec<_>>().await
            })
            .map_err(|error| self.failed(prefix, error))?;
        if objects.len() > limit {
            return Err(StoreError::TooMany { uri: format!("{}/{prefix}", self.root), limit });
        }
        objects.sort();
        Ok(objects)
    }

    fn ranges(&self, object: &ObjectFacts, ranges: &[Range<u64>], sink: Sink) -> Result<(), StoreError> {
        let at = self.path(&object.path)?;
        self.wait(async {
            let pieces = futures::stream::iter(ranges.iter().cloned());
            let mut pieces = pieces.map(|range| self.piece(&at, object, range)).buffered(AT_ONCE).enumerate();
            while let Some((i, piece)) = pieces.next().await {
                let bytes = piece.map_err(|error| self.failed(&object.path, error))?;
                Traffic::add(&self.traffic.bytes_read, bytes.len() as u64);
                sink(i, &bytes)
                    .map_err(|source| StoreError::Scratch { path: object.path.as_str().into(), source })?;
            }
            Ok(())
        })
    }

    fn create(&self, objects: Vec<(String, Vec<u8>)>) -> Result<Vec<Created>, StoreError> {
        self.wait(async {
            let one = |(path, bytes): (String, Vec<u8>)| async move {
                let at = self.path(&path)?;
                self.create_one(&at, bytes).await.map_err(|error| self.failed(&path, error))
            };
            futures::stream::iter(objects).map(one).buffered(AT_ONCE).try_collect().await
        })
    }

    fn get(&self, path: &str, limit: u64) -> Result<Option<Vec<u8>>, StoreError> {
        let at = self.path(path)?;
        let whole = async {
            let found = self.store.get(&at).await?;
            if found.meta.size > limit {
                return Ok(Err(found.meta.size));
            }
            Ok(Ok(found.bytes().await?.to_vec()))
        };
        match self.wait(whole) {
            Ok(Ok(bytes)) => {
                Traffic::add(&self.traffic.bytes_read, bytes.len() as u64);
                Ok(Some(bytes))
            }
            Ok(Err(bytes)) => {
                Err(StoreError::TooLarge { uri: format!("{}/{path}", self.root), bytes, limit })
            }
            Err(Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(self.failed(path, error)),
        }
    }
}

/// The store of a URI.
fn store(uri: &Uri, traffic: &Arc<Traffic>) -> Result<Arc<dyn ObjectStore>, Error> {
    let patience = std::env::var("ARTITWIN_STORE_PATIENCE_S").ok().and_then(|s| s.parse().ok());
    let patience = patience.unwrap_or(PATIENCE_S);
    let retry = RetryConfig {
        backoff: BackoffConfig {
            init_backoff: Duration::from_millis(100),
            max_backoff: Duration::from_secs(15),
            base: 2.0,
        },
        max_retries: RETRIES,
        retry_timeout: Duration::from_secs(patience),
    };
    let client =
        ClientOptions::new().with_timeout(REQUEST).with_connect_timeout(CONNECT).with_pool_idle_timeout(IDLE);
    let counting = Counting { traffic: Arc::clone(traffic) };
    let authority = uri.root.split_once("://").map_or("", |(_, a)| a);
    // `from_env` reads AWS_ALLOW_HTTP and its kin into the options, which ours then replace.
    let allow_http = |name: &str| std::env::var(name).is_ok_and(|v| v.eq_ignore_ascii_case("true"));
    Ok(match uri.scheme {
        Scheme::S3 => Arc::new(
            AmazonS3Builder::from_env()
                .with_client_options(client.with_allow_http(allow_http("AWS_ALLOW_HTTP")))
                .with_bucket_name(authority)
                .with_retry(retry)
                .with_http_connector(counting)
                .build()?,
        ),
        Scheme::Gcs => Arc::new(
            GoogleCloudStorageBuilder::from_env()
                .with_client_options(client.with_allow_http(allow_http("GOOGLE_ALLOW_HTTP")))
                .with_bucket_name(authority)
                .with_retry(retry)
                .with_http_connector(counting)
                .build()?,
        ),
        Scheme::Azure => Arc::new(
            MicrosoftAzureBuilder::from_env()
                .with_client_options(client.with_allow_http(allow_http("AZURE_ALLOW_HTTP")))
                .with_container_name(authority)
                .with_retry(retry)
                .with_http_connector(counting)
                .build()?,
        ),
        Scheme::Http | Scheme::File => Arc::new(
            HttpBuilder::new()
                .with_url(uri.root.clone())
                .with_client_options(client.with_allow_http(true))
                .with_retry(retry)
                .with_http_connector(counting)
                .build()?,
        ),
    })
}

/// Counts what goes through it.
#[derive(Debug)]
struct Counting {
    traffic: Arc<Traffic>,
}

impl HttpConnector for Counting {
    fn connect(&self, options: &ClientOptions) -> Result<HttpClient, Error> {
        let client = ReqwestConnector::default().connect(options)?;
        Ok(HttpClient::new(Counted { client, traffic: Arc::clone(&self.traffic) }))
    }
}

#[derive(Debug)]
struct Counted {
    client: HttpClient,
    traffic: Arc<Traffic>,
}

#[async_trait]
impl HttpService for Counted {
    async fn call(&self, request: HttpRequest) -> Result<HttpResponse, HttpError> {
        Traffic::add(&self.traffic.requests, 1);
        let answer = self.client.execute(request).await;
        // What object_store sends again: no answer, or one that says to come later.
        let again = answer.as_ref().map_or(true, |a| {
            let status = a.status();
            status.is_server_error() || matches!(status.as_u16(), 408 | 429)
        });
        if again {
            Traffic::add(&self.traffic.retries, 1);
        }
        answer
    }
}
