/* Opens a file as most Windows programs do, not to be replaced meanwhile, says so, and closes it: hold FILE MILLISECONDS */
#include <stdio.h>
#include <stdlib.h>
#include <windows.h>

int wmain(int count, wchar_t **words) {
    HANDLE file = CreateFileW(words[1], GENERIC_READ, FILE_SHARE_READ, NULL, OPEN_EXISTING, 0, NULL);
    if (count != 3 || file == INVALID_HANDLE_VALUE) return 1;
    puts("held");
    fflush(stdout);
    Sleep(wcstoul(words[2], NULL, 10));
    CloseHandle(file);
    return 0;
}
