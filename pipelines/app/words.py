"""All texts of the page in one catalogue: English, and German as second language."""

import os
import re
from collections.abc import Callable

from pipelines.api.wording import in_fields
from pipelines.report.inputs import quantity_label

__all__ = ["LANGUAGES", "Say", "hint_of", "label_of", "on_page", "says", "users_language"]

LANGUAGES = {"en": "English", "de": "Deutsch"}
"""Languages by code."""

Say = Callable[..., str]
"""Text of a key; values fill its gaps."""

_TEXTS: dict[str, tuple[str, str]] = {
    "title": ("Impact vision", "Impact vision"),
    "open": ("Open", "Öffnen"),
    "clip": ("Clip", "Aufnahme"),
    "setup": ("Set up", "Einrichten"),
    "folder": ("Folder", "Ordner"),
    "why": ("Why", "Warum"),
    "export": ("Export", "Ausgeben"),
    "pages": ("Pages", "Seiten"),
    "language": ("Language", "Sprache"),
    "dark": ("Dark", "Dunkel"),
    "measuring": ("Measuring: {step}", "Messung: {step}"),
    "starting": ("starting", "Start"),
    "following ball and pendulum": ("following ball and pendulum", "Ball und Pendel verfolgen"),
    "calibrating": ("calibrating", "Kalibrieren"),
    "propagating uncertainty": ("propagating uncertainty", "Unsicherheit berechnen"),
    "facts": (
        "{width} × {height} px, {frames} frames, {rate}",
        "{width} × {height} px, {frames} Bilder, {rate}",
    ),
    "stage": (
        "Frame. Arrow keys step, Shift steps by ten, plus and minus zoom. Drag an outline to"
        " correct it.",
        "Bild. Pfeiltasten blättern, mit Umschalt um zehn, Plus und Minus vergrößern. Einen Umriss"
        " zum Korrigieren ziehen.",
    ),
    "timeline": ("Frame number", "Bildnummer"),
    "frame": ("frame", "Bild"),
    "back": ("Previous frame", "Voriges Bild"),
    "forward": ("Next frame", "Nächstes Bild"),
    "play": ("Play or pause", "Abspielen oder anhalten"),
    "larger": ("Zoom in", "Vergrößern"),
    "smaller": ("Zoom out", "Verkleinern"),
    "ball": ("ball", "Ball"),
    "pendulum": ("pendulum", "Pendel"),
    "contact": ("contact", "Kontakt"),
    "landing": ("landing", "Landung"),
    "begins": ("motion begins", "Bewegung beginnt"),
    "release": ("release", "Loslassen"),
    "bounce": ("bounce", "Aufprall"),
    "stop": ("stop", "Stillstand"),
    "ends": ("motion ends", "Bewegung endet"),
    "this_ball": ("This is the ball", "Das ist der Ball"),
    "this_mass": ("This is the pendulum", "Das ist das Pendel"),
    "ignore": ("Ignore this", "Das nicht"),
    "pivot": ("Pivot", "Drehachse"),
    "axes": ("Axes", "Achsen"),
    "stick": ("Calibration stick", "Maßstab im Bild"),
    "stick_length": ("Its length", "Seine Länge"),
    "stick_needs_length": (
        "Type the length of the stick, such as 1 m ± 2 mm. It must be in the plane of motion.",
        "Die Länge eingeben, etwa 1 m ± 2 mm. Er muss in der Bewegungsebene sein.",
    ),
    "point_at": (
        "Click it in the frame, or move the cross with the arrow keys and press Enter. Esc ends.",
        "Im Bild anklicken, oder das Kreuz mit Pfeiltasten bewegen und Enter drücken. Esc beendet.",
    ),
    "show_found": ("Show all found objects", "Alle gefundenen Objekte zeigen"),
    "undo": ("Undo", "Rückgängig"),
    "redo": ("Redo", "Wiederholen"),
    "results": ("Results", "Ergebnisse"),
    "motion": ("Motion: {kind}, probability {p}", "Bewegung: {kind}, Wahrscheinlichkeit {p}"),
    "sound": ("no contradiction found", "kein Widerspruch gefunden"),
    "assumed": ("assumed: {why}", "angenommen: {why}"),
    "contradicted": ("contradicted by: {why}", "Widerspruch: {why}"),
    "missing": ("not measured: {why}", "nicht gemessen: {why}"),
    "made_of": ("What is this ± made of?", "Woraus besteht dieses ±?"),
    "more": ("All {count} quantities", "Alle {count} Größen"),
    "cure": ("Use {what}: {text}", "{what} einsetzen: {text}"),
    "messages": ("Messages", "Meldungen"),
    "inputs": ("Inputs", "Eingaben"),
    "fps": ("Capture rate", "Bildrate"),
    "ball_input": ("Ball or diameter", "Ball oder Durchmesser"),
    "wall_grid": ("Wall grid", "Wandraster"),
    "scale": ("Scale", "Maßstab"),
    "setup_input": ("Set-up file", "Einrichtungsdatei"),
    "kind": ("Kind of motion", "Art der Bewegung"),
    "kind_found": ("as found", "wie gefunden"),
    "kind_strike": ("strike", "Stoß durch ein Pendel"),
    "kind_flight": ("flight", "Flug"),
    "kind_drop": ("drop", "Fall"),
    "kind_bounce": ("bounce", "Aufprall"),
    "kind_swing": ("swing", "Schwingung"),
    "kind_collision": ("collision of two balls", "Stoß zweier Bälle"),
    "kind_roll": ("roll", "Rollen"),
    "kind_slide": ("slide", "Gleiten"),
    "kind_circle": ("circle", "Kreisbewegung"),
    "kind_carried": ("carried motion", "geführte Bewegung"),
    "kind_none": ("none of the known", "keine bekannte"),
    "inputs_note": (
        "Distances, the pendulum and the air are in the set-up file, which page Set up writes.",
        "Abstände, Pendel und Luft stehen in der Einrichtungsdatei der Seite Einrichten.",
    ),
    "measure": ("Measure", "Messen"),
    "as_command": ("The same as a command", "Dasselbe als Befehl"),
    "as_python": ("The same in Python", "Dasselbe in Python"),
    "copy": ("Copy", "Kopieren"),
    "copied": ("Copied", "Kopiert"),
    "marks": ("Corrections: {count}", "Korrekturen: {count}"),
    "reset": ("Remove all corrections", "Alle Korrekturen entfernen"),
    "no_numbers": (
        "Nothing is measured yet. What would help: {question}",
        "Noch ist nichts gemessen. Das würde helfen: {question}",
    ),
    "which_ball": (
        "which of the found objects is the ball? Choose “This is the ball” and click it.",
        "welches der gefundenen Objekte ist der Ball? „Das ist der Ball“ wählen und anklicken.",
    ),
    "graphs": ("Graphs", "Diagramme"),
    "graphs_note": (
        "A click goes to that frame. Dragging over a time selects a span and fits it. The wheel"
        " zooms, Ctrl and dragging moves.",
        "Ein Klick geht zu diesem Bild. Ziehen über der Zeit wählt einen Abschnitt und passt ihn"
        " an. Das Rad vergrößert, Strg und Ziehen verschiebt.",
    ),
    "fit_of": ("Fit", "Anpassung an"),
    "from_frame": ("From frame", "Von Bild"),
    "to_frame": ("To frame", "Bis Bild"),
    "shape": ("Curve", "Kurve"),
    "shape_line": ("line", "Gerade"),
    "shape_parabola": ("parabola", "Parabel"),
    "shape_sine": ("sine", "Sinus"),
    "fit": ("Fit the span", "Abschnitt anpassen"),
    "term_at_start": ("Value at the first point", "Wert am ersten Punkt"),
    "term_slope": ("Slope at the first point", "Steigung am ersten Punkt"),
    "term_curvature": ("Second derivative", "Zweite Ableitung"),
    "term_mean": ("Mean", "Mittelwert"),
    "term_amplitude": ("Amplitude", "Amplitude"),
    "term_period": ("Period", "Periode"),
    "fit_note": (
        "{count} points, which scatter by {scatter}. The ± is of that scatter alone; scale and rate"
        " come in addition.",
        "{count} Punkte mit einer Streuung von {scatter}. Das ± kommt aus dieser Streuung allein;"
        " Maßstab und Bildrate kommen hinzu.",
    ),
    "path": ("Path", "Bahn"),
    "position": ("Position", "Ort"),
    "speed": ("Speed", "Geschwindigkeit"),
    "gap": ("Gap between pendulum and ball", "Spalt zwischen Pendel und Ball"),
    "angle": ("Angle of the pendulum", "Winkel des Pendels"),
    "open_title": ("Open a clip", "Eine Aufnahme öffnen"),
    "drop": ("Drop a clip here, or choose it with +", "Aufnahme hierher ziehen, oder mit + wählen"),
    "drop_note": (
        "It stays on this computer: a dropped clip is copied to {folder}.",
        "Sie bleibt auf diesem Rechner: eine Kopie kommt nach {folder}.",
    ),
    "path_of": ("Path of a clip or folder", "Pfad einer Aufnahme oder eines Ordners"),
    "not_copied": ("The clip can't be copied: {why}.", "Die Kopie gelingt nicht: {why}."),
    "recent": ("Recent", "Zuletzt geöffnet"),
    "samples": ("Samples", "Beispiele"),
    "strike": ("Strike", "Stoß"),
    "drop_kind": ("Drop", "Fall"),
    "swing": ("Swing", "Schwingung"),
    "sample_strike": (
        "A pendulum strikes a basketball: contact, launch, landing, restitution.",
        "Ein Pendel stößt einen Basketball: Kontakt, Abflug, Landung, Stoßzahl.",
    ),
    "sample_drop": (
        "A ball falls: the acceleration of gravity.",
        "Ein Ball fällt: die Fallbeschleunigung.",
    ),
    "sample_swing": ("A pendulum swings: its period.", "Ein Pendel schwingt: seine Dauer."),
    "how_to_film": ("How to film", "So filmen"),
    "film_good": (
        "Camera on a tripod, square to the wall; the ball moves along the wall.",
        "Kamera auf Stativ, senkrecht zur Wand; der Ball bewegt sich die Wand entlang.",
    ),
    "film_bad": (
        "Not oblique, and not with a ball that comes nearer: both change the scale.",
        "Nicht schräg, und kein Ball, der näher kommt: beides ändert den Maßstab.",
    ),
    "export_of": ("Export of {name}", "Ausgabe von {name}"),
    "nothing_to_export": (
        "Nothing is measured yet: first measure the clip.",
        "Noch ist nichts gemessen: zuerst die Aufnahme messen.",
    ),
    "sheet": ("One A4 page", "Eine A4-Seite"),
    "sheet_note": (
        "Opens in a new window; print it or save it as PDF there.",
        "Öffnet ein neues Fenster; dort drucken oder als PDF speichern.",
    ),
    "export_note": ("Files are written to {folder}.", "Dateien kommen nach {folder}."),
    "export_report": ("Report", "Bericht"),
    "export_workbook": ("Workbook", "Arbeitsmappe"),
    "export_csv": ("Results as CSV", "Ergebnisse als CSV"),
    "export_json": ("Results as JSON", "Ergebnisse als JSON"),
    "export_tracks": ("Tracks", "Bahnen"),
    "export_tracker": ("Project for Tracker", "Projekt für Tracker"),
    "export_kinovea": ("Project for Kinovea", "Projekt für Kinovea"),
    "export_overlay": ("Video with outlines", "Film mit Umrissen"),
    "export_notebook": ("Notebook that repeats it", "Notebook, das es wiederholt"),
    "writing": ("Writing {name}", "{name} wird geschrieben"),
    "written": ("Written: {name}", "Geschrieben: {name}"),
    "campaign_of": ("Campaign {name}", "Messreihe {name}"),
    "progress": ("Measured clips", "Gemessene Aufnahmen"),
    "folder_counts": (
        "{done} measured, {failed} failed, {waiting} waiting",
        "{done} gemessen, {failed} misslungen, {waiting} warten",
    ),
    "folder_running": (
        "Measuring: {done} measured, {failed} failed, {running} under way, {waiting} waiting",
        "Messung: {done} gemessen, {failed} misslungen, {running} in Arbeit, {waiting} warten",
    ),
    "trials": ("Lab book (CSV or XLSX)", "Laborbuch (CSV oder XLSX)"),
    "paste": ("Paste the lab book from a spreadsheet", "Laborbuch aus einer Tabelle einfügen"),
    "paste_here": (
        "Cells with their headings: clip, and ball, backswing or session of each",
        "Zellen mit Überschriften: clip, dazu ball, backswing oder session",
    ),
    "paste_use": ("Use as lab book", "Als Laborbuch verwenden"),
    "measure_all": ("Measure all", "Alle messen"),
    "cor_graph": ("Restitution against impact speed", "Stoßzahl über Stoßgeschwindigkeit"),
    "cor_note": ("A click on a point opens its clip.", "Ein Klick öffnet die Aufnahme."),
    "film_more": (
        "for ± {target} film at least {count} more near {speed} m/s (now ± {std} there).",
        "für ± {target} noch mindestens {count} bei {speed} m/s filmen (dort jetzt ± {std}).",
    ),
    "filmed_enough": (
        "the law is known to ± {std} or better over the speeds filmed.",
        "das Gesetz ist bei allen gefilmten Geschwindigkeiten auf ± {std} oder besser bekannt.",
    ),
    "counts": ("counts", "zählt"),
    "excluded": ("marked as bad", "als schlecht markiert"),
    "law": ("fitted law", "angepasstes Gesetz"),
    "show_all": ("all", "alle"),
    "show_unsure": ("uncertain or failed", "unsicher oder misslungen"),
    "show_bad": ("marked as bad", "als schlecht markiert"),
    "folder_note": (
        "If the wrong object was followed, click the ball in the picture: the clip is measured"
        " again. A trial marked as bad keeps its row and is excluded from the laws.",
        "Wurde das Falsche verfolgt, den Ball im Bild anklicken: die Aufnahme wird neu gemessen."
        " Ein schlechter Versuch behält seine Zeile und zählt nicht für die Gesetze.",
    ),
    "frame_of": ("Frame with outlines", "Bild mit Umrissen"),
    "state_waiting": ("waiting", "wartet"),
    "state_running": ("being measured", "wird gemessen"),
    "state_done": ("measured, without these numbers", "gemessen, ohne diese Zahlen"),
    "state_failed": ("failed", "misslungen"),
    "uncertain_motion": ("Motion uncertain: {kind}", "Bewegung unsicher: {kind}"),
    "pointed": ("Ball selected at {at} px", "Ball gewählt bei {at} px"),
    "bad": ("Bad: {why}", "Schlecht: {why}"),
    "why_bad": ("Why this trial is bad", "Warum dieser Versuch schlecht ist"),
    "mark": ("Mark as bad", "Als schlecht markieren"),
    "unmark": ("Remove mark", "Markierung entfernen"),
    "gone": ("{name} is no longer there.", "{name} ist nicht mehr da."),
    "why_of": ("Why: {name}", "Warum: {name}"),
    "why_note": (
        "Compares the recording with the model of the set-up, and names the physics that is"
        " missing. It takes up to some minutes.",
        "Vergleicht die Aufnahme mit dem Modell der Einrichtung und nennt die Physik, die fehlt."
        " Es dauert bis zu einigen Minuten.",
    ),
    "why_alone": (
        "Compares the recording with gravity alone: free fall, or a bob on a light cord. It names"
        " what is missing, such as drag or friction.",
        "Vergleicht die Aufnahme mit der Schwerkraft allein: freier Fall, oder ein Pendel an einem"
        " leichten Faden. Es nennt, was fehlt, etwa Luftwiderstand oder Reibung.",
    ),
    "explain": ("Compare", "Vergleichen"),
    "explaining": ("Comparing recording and model", "Aufnahme und Modell werden verglichen"),
    "why_picture": (
        "Residuals before and after, and the missing force",
        "Abweichungen vorher und nachher, und die fehlende Kraft",
    ),
    "why_all": ("Everything that was tried", "Alles, was versucht wurde"),
    "setup_of": ("Set-up of {name}", "Einrichtung von {name}"),
    "opening_clip": ("Opening the clip, searching wall grid and ball", "Aufnahme wird geöffnet"),
    "computing": ("Computing the uncertainty", "Unsicherheit wird berechnet"),
    "searching_grid": ("Searching for the wall grid", "Wandraster wird gesucht"),
    "measuring_corners": ("Measuring between the corners", "Messung zwischen den Ecken"),
    "tracking_ball": ("Tracking the ball", "Ball wird verfolgt"),
    "card_rate": ("Capture rate", "Bildrate"),
    "card_wall": ("Wall grid", "Wandraster"),
    "card_ball": ("Ball and support", "Ball und Auflage"),
    "card_distances": ("Distances", "Abstände"),
    "card_pendulum": ("Pendulum", "Pendel"),
    "card_lens": ("Lens", "Objektiv"),
    "fine_grid": ("Distance of fine lines", "Abstand der feinen Linien"),
    "ball_and_mass": ("Ball, or diameter and mass", "Ball, oder Durchmesser und Masse"),
    "support": ("Height of the support", "Höhe der Auflage"),
    "camera_distance": ("Camera to wall", "Kamera zur Wand"),
    "ball_plane": ("Ball's plane to wall", "Ballebene zur Wand"),
    "pendulum_mass": ("Mass of all that swings", "Masse von allem, was schwingt"),
    "pendulum_length": ("Pivot to where it strikes", "Drehachse bis zum Treffpunkt"),
    "pendulum_com": ("Pivot to centre of mass", "Drehachse bis zum Schwerpunkt"),
    "pendulum_period": ("Period, for the inertia", "Schwingungsdauer, für das Trägheitsmoment"),
    "pendulum_inertia": ("Inertia about the pivot", "Trägheitsmoment um die Drehachse"),
    "lens_file": ("Lens file, or folder of pictures", "Objektivdatei, oder Ordner mit Bildern"),
    "rate_known": (
        "{fps} fps: free fall determines the scale in addition.",
        "{fps} fps: der freie Fall bestimmt zusätzlich den Maßstab.",
    ),
    "rate_assumed": (
        "Unknown: {fps} fps is assumed. Every time and speed scales with it, and gravity can't be"
        " used as a scale. Find it in the camera's menu or manual.",
        "Unbekannt: {fps} fps ist angenommen. Jede Zeit und Geschwindigkeit hängt davon ab. Sie"
        " steht im Menü oder in der Anleitung der Kamera.",
    ),
    "pitch_assumed": ("Squares of 50 mm are assumed.", "Quadrate von 50 mm sind angenommen."),
    "grid_found": (
        "Found automatically: {count} crossings, each ± {std} px.",
        "Selbst gefunden: {count} Kreuzungen, jede ± {std} px.",
    ),
    "grid_corners": (
        "Measured between your corners: {count} crossings, each ± {std} px.",
        "Zwischen den Ecken gemessen: {count} Kreuzungen, jede ± {std} px.",
    ),
    "grid_hand": (
        "No lines found: your {count} corners are the grid, each ± {std} px.",
        "Keine Linien gefunden: die {count} Ecken sind das Raster, jede ± {std} px.",
    ),
    "not_tracked": (
        "The ball is not tracked yet; its track determines rest, landing and size.",
        "Der Ball ist noch nicht verfolgt; seine Bahn bestimmt Ruhelage, Landung und Größe.",
    ),
    "tracked_to_landing": (
        "Tracked from rest to its lowest position, the landing.",
        "Von der Ruhelage bis zum tiefsten Ort, der Landung, verfolgt.",
    ),
    "tracked": ("Tracked; its landing is not seen.", "Verfolgt; die Landung ist nicht zu sehen."),
    "track_ball": ("Track the ball", "Ball verfolgen"),
    "distances_note": (
        "Both may stay empty: grid, ball and free fall determine them less precisely than a tape.",
        "Beide dürfen leer bleiben: Raster, Ball und Fall bestimmen sie ungenauer als ein Maßband.",
    ),
    "depth_from": (
        "Ball's plane to wall from {source} alone: {value}.",
        "Ballebene zur Wand allein aus {source}: {value}.",
    ),
    "pendulum_note": (
        "For restitution, impulse and energy. Time ten swings of less than 10° and give the period:"
        " the inertia follows.",
        "Für Stoßzahl, Kraftstoß und Energie. Zehn Schwingungen unter 10° stoppen und die Dauer"
        " angeben: das Trägheitsmoment folgt.",
    ),
    "lens_note": (
        "The wall grid determines the lens, too. A folder of pictures of the printed board helps"
        " where the camera is square to the wall.",
        "Auch das Wandraster bestimmt das Objektiv. Ein Ordner mit Bildern der gedruckten Tafel"
        " hilft, wenn die Kamera senkrecht zur Wand steht.",
    ),
    "focal": ("Focal length {value}.", "Brennweite {value}."),
    "by_hand": ("Set four corners by hand", "Vier Ecken von Hand setzen"),
    "across": ("Squares across", "Quadrate quer"),
    "up": ("Squares up", "Quadrate hoch"),
    "measure_corners": ("Measure between them", "Dazwischen messen"),
    "point_rest": ("Ball at rest", "Ball in Ruhe"),
    "point_landing": ("Landing", "Landung"),
    "point_origin": ("Origin of the wall", "Ursprung der Wand"),
    "landing_assumed": ("Landing (assumed)", "Landung (angenommen)"),
    "layer": ("Drawn over the frame", "Über dem Bild"),
    "layer_grid": ("grid lines", "Rasterlinien"),
    "layer_map": ("uncertainty map", "Karte der Unsicherheit"),
    "layer_none": ("nothing", "nichts"),
    "map_note": (
        "Standard uncertainty of positions on the ball's plane, relative to the ball at rest.",
        "Unsicherheit von Orten in der Ballebene, bezogen auf den ruhenden Ball.",
    ),
    "expected": ("Landing uncertainty to expect", "Zu erwartende Unsicherheit der Landung"),
    "expected_open": ("Unknown yet.", "Noch unbekannt."),
    "expected_at": (
        "at the landing, {distance} from rest (one standard uncertainty)",
        "an der Landung, {distance} von der Ruhelage (eine Standardunsicherheit)",
    ),
    "expected_assumed": (
        "at an assumed landing, {distance} from rest (one standard uncertainty)",
        "an einer angenommenen Landung, {distance} von der Ruhelage (eine Standardunsicherheit)",
    ),
    "ball_is_scale": (
        "There is no wall grid: the ball's diameter is the scale. The landing is then less certain;"
        " a stick on page Clip helps.",
        "Ohne Wandraster ist der Durchmesser des Balls der Maßstab. Die Landung ist unsicherer;"
        " ein Maßstab auf der Seite Aufnahme hilft.",
    ),
    "verify_length": ("Verify a known length", "Eine bekannte Länge prüfen"),
    "place_ends": ("Place its ends", "Ihre Enden setzen"),
    "known_length": ("Known length", "Bekannte Länge"),
    "plane": ("Plane", "Ebene"),
    "on_wall": ("on the wall", "an der Wand"),
    "on_ball_plane": ("on the ball's plane", "in der Ballebene"),
    "save": ("Save only", "Nur speichern"),
    "writes": ("Measure writes {name}.", "Messen schreibt {name}."),
    "replaces": ("Measure replaces {name}.", "Messen ersetzt {name}."),
    "closed": (
        "The page is closed. You can close this window.",
        "Die Seite ist beendet. Dieses Fenster kann geschlossen werden.",
    ),
    "close": ("Quit", "Beenden"),
    "not_saved": ("The corrections are not saved: {why}", "Nicht gespeichert: {why}"),
}

_GERMAN_LABELS = {
    "contact_frames": "Bilder mit Kontakt",
    "contact_time": "Kontaktzeit Δt",
    "contact_start": "Kontakt beginnt",
    "contact_end": "Kontakt endet",
    "pendulum_speed_before": "Pendelgeschwindigkeit davor",
    "pendulum_speed_after": "Pendelgeschwindigkeit danach",
    "ball_speed": "Ballgeschwindigkeit beim Ablösen",
    "launch_angle": "Abflugwinkel",
    "landing_distance": "Wurfweite, korrigiert",
    "landing_distance_on_wall": "Wurfweite, an der Wand abgelesen",
    "landing_time": "Zeit vom Kontakt bis zur Landung",
    "cor_speeds": "Stoßzahl aus den Geschwindigkeiten (Gl. 2)",
    "cor_launch": "Stoßzahl aus dem Abflug (Gl. 9–10)",
    "cor_range": "Stoßzahl aus der Wurfweite (Gl. 17)",
    "cor": "Stoßzahl, Mittel der Schätzungen",
    "external_impulse": "äußerer Kraftstoß auf den Ball",
    "energy_loss": "Energieverlust des Pendels (Gl. 18)",
    "backswing_angle": "Ausholwinkel",
    "ball_plane_offset": "Ballebene vor der Wand",
    "camera_distance": "Abstand Kamera–Wand",
    "fall_acceleration": "Fallbeschleunigung",
    "flight_speed": "Geschwindigkeit im ersten Bild des Flugs",
    "flight_angle": "Winkel im ersten Bild des Flugs",
    "swing_period": "Schwingungsdauer",
    "swing_damping": "Dämpfung der Schwingung",
    "cor_bounce": "Stoßzahl des ersten Aufpralls",
    "roll_acceleration": "Beschleunigung entlang der Bahn",
    "roll_speed": "Geschwindigkeit im ersten Bild des Rollens",
}


_QUANTITY_HINTS = {
    "contact_frames": (
        "Frames in which ball and pendulum touch",
        "Bilder, in denen sich Ball und Pendel berühren",
    ),
    "contact_time": (
        "From first touch to release, also between frames",
        "Von der ersten Berührung bis zum Ablösen, auch zwischen den Bildern",
    ),
    "launch_angle": (
        "Of the ball's velocity at release, above the horizontal",
        "Der Ballgeschwindigkeit beim Ablösen, über der Waagrechten",
    ),
    "landing_distance": (
        "From the ball's rest to its landing, in the plane of its flight",
        "Von der Ruhelage des Balls bis zur Landung, in der Ebene des Flugs",
    ),
    "landing_distance_on_wall": (
        "As the grid behind the ball reads: too far, as the ball is nearer to the camera",
        "Wie am Raster hinter dem Ball abgelesen: zu weit, denn der Ball ist näher an der Kamera",
    ),
    "cor": (
        "Coefficient of restitution: speed of separation over speed of approach, 1 without loss",
        "Stoßzahl: Geschwindigkeit des Trennens durch die des Annäherns, 1 ohne Verlust",
    ),
    "external_impulse": (
        "Mass of the ball times its speed at release",
        "Masse des Balls mal Geschwindigkeit beim Ablösen",
    ),
    "energy_loss": (
        "Kinetic energy of the pendulum before the contact minus that after it",
        "Bewegungsenergie des Pendels vor dem Kontakt minus der danach",
    ),
    "backswing_angle": (
        "From the lowest point, where the pendulum is let go",
        "Vom tiefsten Punkt aus, wo das Pendel losgelassen wird",
    ),
    "fall_acceleration": (
        "Downwards; 9.81 m/s² where rate and scale are right",
        "Nach unten; 9,81 m/s², wenn Bildrate und Maßstab stimmen",
    ),
    "roll_acceleration": (
        "Along the line of motion, positive where it speeds up",
        "Entlang der Bahn, positiv, wenn es schneller wird",
    ),
    "swing_period": ("Time of one swing to and fro", "Dauer einer Schwingung hin und her"),
    "swing_damping": (
        "The amplitude falls as exp(−damping · t)",
        "Die Auslenkung nimmt ab wie exp(−Dämpfung · t)",
    ),
    "std": (
        "Standard uncertainty: in 2 of 3 cases the true value is within ±",
        "Standardunsicherheit: in 2 von 3 Fällen liegt der wahre Wert innerhalb von ±",
    ),
}
"""Explanations that are shown on hovering; an estimate of a quantity has that quantity's."""


def hint_of(name: str, language: str) -> str:
    """Explanation of a quantity; empty if its label says it all."""
    plain = name.removesuffix("_px")
    known = _QUANTITY_HINTS.get(plain) or _QUANTITY_HINTS.get(plain.partition("_")[0])
    return "" if known is None else known[list(LANGUAGES).index(language)]


def says(language: str) -> Say:
    """Function that gives the texts of a language.

    Parameters
    ----------
    language : str
        A key of `LANGUAGES`.
    """
    place = list(LANGUAGES).index(language)

    def say(key: str, **values: object) -> str:
        return _TEXTS[key][place].format(**values)

    return say


def label_of(name: str, language: str) -> str:
    """Label of a quantity."""
    own = _GERMAN_LABELS.get(name.removesuffix("_px")) if language == "de" else None
    return own or quantity_label(name)


_FIELD_KEYS = {
    "fps": "fps",
    "ball": "ball_input",
    "wall-grid": "wall_grid",
    "scale": "scale",
    "setup": "setup_input",
    "ball-at": "this_ball",
    "mass-at": "this_mass",
    "pivot-at": "pivot",
    "landing-at": "point_landing",
    "axes": "axes",
    "kind": "kind",
    "support-height": "support",
    "camera-distance": "camera_distance",
    "ball-plane": "ball_plane",
}
"""Keys of the fields and buttons that are options of `vision measure`."""


_POINT = re.compile(r"” -?\d+(?:\.\d+)?,-?\d+(?:\.\d+)?(?:,(\d+))?")
"""A button with the pixel at which a command would point."""


def on_page(message: str, say: Say) -> str:
    """A message as a sentence, with fields and buttons in place of options."""
    placed = in_fields(message, {option: say(key) for option, key in _FIELD_KEYS.items()})
    placed = _POINT.sub(lambda found: f"” ({say('frame')} {found[1]})" if found[1] else "”", placed)
    return placed[:1].upper() + placed[1:]


def users_language() -> str:
    """Language of the user's system if there is a catalogue for it, else English."""
    for name in ("LC_ALL", "LC_MESSAGES", "LANG"):
        if text := os.environ.get(name):
            code = text[:2].lower()
            return code if code in LANGUAGES else "en"
    return "en"
