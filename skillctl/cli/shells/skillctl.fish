# Completion of skillctl for fish, printed by `skillctl completion fish`.
function __skillctl_complete
    set -l words (commandline -opc)
    set -l current (commandline -ct)
    set -l answer ($words[1] __complete words $words[2..] "$current" 2>/dev/null)
    printf '%s\n' $answer[2..]
    set -l kind (string split ' ' -- "$answer[1]")
    set -l settled (string sub --length "$kind[2]" -- "$current")
    set -l path (string sub --start (math "$kind[2]" + 1) -- "$current")
    switch "$kind[1]"
        case files
            printf "$settled%s\n" (__fish_complete_path "$path")
        case directories
            printf "$settled%s\n" (__fish_complete_directories "$path")
    end
end
complete --command skillctl --no-files --arguments '(__skillctl_complete)'
