"""What lies behind a URL: buckets and web servers, in the words of paths and bytes."""
