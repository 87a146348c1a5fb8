/* Stands in for Windows' bcryptprimitives.dll, which Wine 8 lacks and Rust's standard library imports. Only for tests. */
#include <windows.h>
#include <ntsecapi.h>
__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE p, SIZE_T n) { return RtlGenRandom(p, (ULONG)n); }
